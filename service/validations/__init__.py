"""Validations: calibrations held against other pairs and drives, and a camera's results over time."""
