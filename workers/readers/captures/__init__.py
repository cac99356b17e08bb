"""Network captures of Velodyne sensors: packets in, sweeps out."""
