"""MCAP files as they are written: chunks with their indexes, and what a file says of itself at its end."""
