"""Calibrations of many vehicles, asked for in one call."""
