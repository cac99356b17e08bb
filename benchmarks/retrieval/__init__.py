"""How fast a vehicle gets its calibration."""
