"""Calibrations in the formats of other programs: one short file each, and one line in ``formats``."""
