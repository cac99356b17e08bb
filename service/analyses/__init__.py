"""Analyses of a recording: region previews, region suggestions, clock offsets, packed sweeps, calibrated copies."""
