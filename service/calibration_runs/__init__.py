"""State transitions of a calibration: runs, fan-in, conclusion, and the counters of its fleet request."""
