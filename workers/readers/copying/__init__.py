"""A recording's own file with a calibration put in, and a file of it for viewers."""
