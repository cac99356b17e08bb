"""Network captures of LiDARs: packets in, sweeps out. A maker is a folder."""
