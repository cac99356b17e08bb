"""The one judge of calibrations: the checks of a fit, and those of a calibration's end."""
