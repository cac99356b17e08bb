"""Whether a pattern's line was taken for the board's edge: its true edge lies as many metres outside in all frames.

One frame cannot tell. What stands behind the board differs from frame to frame, so the median over frames of how much
the image changes at a distance from the measured edges stands out only where the board itself ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import cv2
import numpy as np

from workers.marks.edges import CornerFit, inward
from workers.marks.profiles import (
    SHARPEST_PX,
    SHORTEST_PX,
    SOFTEST_PX,
    STEP_PX,
    Crop,
    Curve,
    TracedEdge,
    slopes_of,
    trace_edge,
)
from workers.marks.sights import Floats, Image

STEP_M: Final = 0.0025
REACH_M: Final = 0.25
"""A pattern's margin: printed boards have less than a quarter of a metre."""
_REACH_PX: Final = 80.0
_GUARD: Final = 2.5  # of the edges' softness with the filter's: nearer is the measured edge's own slope
_PARTS: Final = 6  # an edge is cut into so many parts, half of which decide: hands hold it in one or two
_FEWEST: Final = 8
_STANDS_OUT: Final = 1.6
_RIVALS: Final = 0.5  # of the highest: lower tops are its side lobes


def changes_outside(image: Image, edges: tuple[Curve, Curve], fit: CornerFit, px_per_m: Floats) -> Floats:
    """(2, G) how much the image changes along both measured edges moved outward by steps of STEP_M.

    One is the usual change in this frame, not a number what is too near or outside of the frame.

    Args:
        px_per_m: (2, 2) for both edges, at the corner and at the far end: pixels across the edge for a metre.
    """
    grid = np.arange(STEP_M, REACH_M, STEP_M)
    changes_at = np.full((2, len(grid)), np.nan)
    sigma = float(np.clip(fit.softness_px, SHARPEST_PX, SOFTEST_PX))
    for row, (curve, line, within, scales) in enumerate(zip(edges, fit.lines, inward(edges), px_per_m, strict=True)):
        traced = trace_edge(curve, image.shape[1], image.shape[0])
        if not isinstance(traced, TracedEdge) or not np.all(np.isfinite(scales)) or scales.min() <= 0.0:
            continue
        scale = float(scales.mean())
        pad = float(np.ceil(3.0 * sigma / STEP_PX))
        last = min(REACH_M * scale, _REACH_PX) / STEP_PX + pad + 1.0
        steps: Floats = STEP_PX * np.arange(-pad, last, dtype=np.float64)
        spread = scales[0] + (scales[1] - scales[0]) * traced.along / traced.length
        outward = -np.sign(within) * steps[None] * (spread / scale)[:, None]
        places = traced.moved(*line).pixels[:, None] + outward[..., None] * traced.normals[:, None]
        profiles = Crop.around(image, places.reshape(-1, 2)).sampled(places)
        profiles = profiles[np.isfinite(profiles).all(axis=1)]
        if len(profiles) < SHORTEST_PX:
            continue
        slope = slopes_of(profiles, sigma)[0]
        parts = np.array([part.mean(axis=0) for part in np.array_split(slope, _PARTS)])
        change = np.median(np.abs(parts), axis=0)
        # Half a pixel to either side: scale and direction are known to that.
        change = cv2.dilate(change[None], np.ones((1, 3))).ravel()
        counted = (steps >= _GUARD * float(np.hypot(sigma, fit.softness_px))) & (steps <= steps[-1] - pad * STEP_PX)
        if counted.sum() < _FEWEST:
            continue
        usual = max(float(np.median(change[counted])), 1e-6)
        at = grid * scale
        is_inside = (at >= steps[counted][0]) & (at <= steps[counted][-1])
        changes_at[row, is_inside] = np.interp(at[is_inside], steps, change / usual)
    return changes_at


def outer_distance_m(changes: Sequence[Floats]) -> float:
    """Return how far outside of the measured edges the board ends, by the changes (2, G) of frames; 0 if at them."""
    rows = np.concatenate(changes) if changes else np.empty((0, 1))
    enough = np.isfinite(rows).sum(axis=0) >= max(_FEWEST, 0.25 * len(rows))
    if not enough.any():
        return 0.0
    pooled = np.full(rows.shape[1], 0.0)
    pooled[enough] = np.nanmedian(rows[:, enough], axis=0)
    least = _STANDS_OUT * float(np.median(pooled[enough]))
    tops = np.flatnonzero((pooled[1:-1] >= pooled[:-2]) & (pooled[1:-1] > pooled[2:]) & (pooled[1:-1] > least)) + 1
    # Nearest to the measured edge the change is the flank of its own.
    tops = tops[tops > np.flatnonzero(enough)[0] + 1]
    if not tops.size:
        return 0.0
    outermost = tops[pooled[tops] > _RIVALS * pooled[tops].max()][-1]
    return STEP_M * (1.0 + float(outermost))
