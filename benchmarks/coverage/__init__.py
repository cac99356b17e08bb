"""How often what a calibration publishes holds, end to end, on data with blunders and shared errors."""
