"""Rules of a fit for its pairs and lenses, and for cutting its work: the words that requests choose from."""

from __future__ import annotations

from typing import Literal

Loss = Literal["mean", "saturating"]
OutlierRule = Literal["keep", "exclude"]
# What pairs weigh by; `auto` is by their covariances where all state them.
Weights = Literal["equal", "covariances"]
WeightRule = Literal["auto", "equal", "covariances"]
# How a fit uses a stated lens; `free` only compares with it, `auto` locks it if the pairs are too few to refine it.
LensUse = Literal["auto", "free", "bounds", "prior", "locked"]
# Where a result's lens comes from.
LensOrigin = Literal["fitted", "stated", "stated, refined"]
Farm = Literal["auto", "slots", "runs"]
CommonError = Literal[
    "azimuth_deg",
    "elevation_deg",
    "tip_across_mm",
    "tip_up_mm",
    "range_mm",
    "tilt_up_deg",
    "tilt_across_deg",
    "corners_out_mm",
    "mark_u_px",
    "mark_v_px",
    "clock_ms",
    "line_time_us",
    "person_px",
]
"""Errors that all pairs share: of the vertices' direction, of the tip in the board's plane, of the range, of how
boards stand and how far out their corners are (where a pose has several), of the marks, of the offset between the
clocks, of the camera's line time; and those that all marks of one person share."""
