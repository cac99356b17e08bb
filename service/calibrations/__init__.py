"""Correspondence sets, calibration requests and results."""
