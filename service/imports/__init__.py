"""Calibrations of other programs: one short file for each format, and one line in ``formats``."""
