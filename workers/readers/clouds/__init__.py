"""From a file's columns to sweeps: returns, rings by elevation, the moment of each point."""
