"""Region of interest, detectors, frame pairing."""
