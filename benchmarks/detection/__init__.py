"""How precise the detectors are on simulated walks, and how fast."""
