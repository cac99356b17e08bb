"""A calibration tested on data that it was not fitted to: other pairs, lane markers, edges."""
