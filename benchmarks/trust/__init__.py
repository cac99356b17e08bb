"""Whether verdicts name what is wrong with a calibration, and leave sound ones alone."""
