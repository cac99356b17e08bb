"""How often a calibration is published by itself and wrong, over cases of what goes wrong with pairs."""
