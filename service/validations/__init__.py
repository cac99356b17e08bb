"""Validations: calibrations tested on other pairs and drives, and a camera's results over time."""
