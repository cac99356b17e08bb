"""A calibration held against data that it was not fitted to: other pairs, lane markers, edges."""
