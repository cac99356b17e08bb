"""Measure where two straight edges of the board meet in a frame: profiles across both, a robust line through each.

A line is fitted to the offsets of the profiles' edges from the projected edge, so that a lens may bend both alike.
"""

from __future__ import annotations

from typing import Final, Literal, NamedTuple

import numpy as np

from workers.marks.edge_lines import EdgeLine, fit_edge
from workers.marks.profiles import (
    SHARPEST_PX,
    SOFTEST_PX,
    WIDEST_PX,
    Crop,
    Curve,
    TracedEdge,
    trace_edge,
)
from workers.marks.sights import Floats, Image

HALF_WIDTHS_PX: Final = (WIDEST_PX, 16.0, 8.0, 4.0, 3.0)
AGREEING: Final = 0.35
_BOTH_AGREEING: Final = 1.0  # of both edges together: mere texture reaches 0.8 (development scenes)
FARTHEST_PX: Final = 30.0
_TOLERANCE_PX: Final = (3.0, 1.5, 1.0, 0.5, 0.4)


class SecondPlace(NamedTuple):
    """Another place (2,) px where a corner may be, and its probability."""

    pixel: Floats
    weight: float


class CornerFit(NamedTuple):
    """The corner (2,) px, its covariance (2, 2) by the profiles' scatter, and how soft the edges are, px.

    `lines` (2, 2): offset and slope of both edges against their projections; `normals` (2, 2): of both lines.
    `extrapolation` (2, 2): what an error of both edges of variance 1 adds to the corner's, because it lies farther
    out than the edges are seen. `ambiguity` (2, 2): what other edges add that may be the board's. `second`: the other
    place of a corner that has two.
    """

    pixel: Floats
    covariance: Floats
    softness_px: float
    lines: Floats
    extrapolation: Floats
    normals: Floats
    ambiguity: Floats
    second: SecondPlace | None = None

    def shifted(self, offsets: Floats, variances: Floats) -> CornerFit:
        """The corner after its lines' shifts (2,) px along the normals, known to variances (2,)."""
        inverse = np.linalg.inv(self.normals)
        return self._replace(
            pixel=self.pixel + inverse @ offsets,
            ambiguity=inverse @ np.diag(variances) @ inverse.T,
        )


EdgeRefusal = Literal["outside", "few_pixels", "no_edge", "moved_far"]


def measure_corner(
    image: Image, edges: tuple[Curve, Curve], first_half_width: float = HALF_WIDTHS_PX[1], softness: float = 1.0
) -> CornerFit | EdgeRefusal:
    """The corner where two edges meet, measured from their projections on; or why not.

    Args:
        edges: the projections of both edges from the corner on.
        first_half_width: one of `HALF_WIDTHS_PX`: those above are skipped. The corner may move twice as far.
        softness: standard deviation of the frame's blur, px, as far as it is known.
    """
    pair: list[TracedEdge] = []
    for curve in edges:
        edge = trace_edge(curve, image.shape[1], image.shape[0])
        if not isinstance(edge, TracedEdge):
            return edge
        pair.append(edge)
    inside = inward(edges)
    crop = Crop.around(image, np.concatenate([edge.pixels for edge in pair]))
    start = np.asarray(edges[0](np.zeros(1)), np.float64)[0]
    lines: list[EdgeLine] = []
    total = np.zeros((2, 2))
    for half_width, tolerance in zip(HALF_WIDTHS_PX, _TOLERANCE_PX, strict=True):
        if half_width > first_half_width:
            continue
        fitted = [
            fit_edge(crop, edge.moved(*shift), half_width, tolerance, softness, within)
            for edge, shift, within in zip(pair, total, inside, strict=True)
        ]
        lines = [line for line in fitted if line is not None]
        if len(lines) < 2 or min(line.agreeing for line in lines) < AGREEING:
            return "no_edge"
        total += [(line.offset, line.slope) for line in lines]
        softness = float(np.clip(np.mean([line.softness for line in lines]), SHARPEST_PX, SOFTEST_PX))
        corner = _intersection(edges, total)
        if corner is None:
            return "no_edge"
        if np.hypot(*(corner - start)) > max(FARTHEST_PX, 2.0 * first_half_width):
            return "moved_far"
    if sum(line.agreeing for line in lines) < _BOTH_AGREEING:
        return "no_edge"
    # Evenly seen over a length L, a line is known to (1 + 12 x^2 / L^2) / N at x from the middle, to 4 / N at its end
    # (Seber and Lee 2003, ch. 6): this is how much more, at the corner, what shifts an edge counts if it may turn it.
    growth = [3.0 * edge.hidden_share * (1.0 + edge.hidden_share) for edge in pair]
    return _with_covariance(edges, total, lines, float(np.mean([line.softness for line in lines])), growth)


def _tangents(edges: tuple[Curve, Curve]) -> tuple[Floats, Floats]:
    """The corner (2,) and both edges' unit tangents (2, 2) there."""
    ends = [np.asarray(curve(np.array([0.0, 0.02])), np.float64) for curve in edges]
    tangents = np.array([end[1] - end[0] for end in ends])
    return ends[0][0], tangents / np.maximum(np.linalg.norm(tangents, axis=1, keepdims=True), 1e-12)


def inward(edges: tuple[Curve, Curve]) -> tuple[float, float]:
    """Return, for each edge, the other's component along its normal; the sign is that of offsets into the board."""
    tangents = _tangents(edges)[1]
    across = np.column_stack([-tangents[:, 1], tangents[:, 0]])
    return float(across[0] @ tangents[1]), float(across[1] @ tangents[0])


def _system(edges: tuple[Curve, Curve], lines: Floats) -> tuple[Floats, Floats, Floats]:
    """Normals (2, 2) of both lines at the corner, their offsets (2,) from it, and the corner itself.

    A line of offset a and slope b along the edge goes through corner + a n with direction t + b n.
    """
    corner, tangents = _tangents(edges)
    across = np.column_stack([-tangents[:, 1], tangents[:, 0]])
    direction = tangents + lines[:, 1:] * across
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    normals = np.column_stack([-direction[:, 1], direction[:, 0]])
    return normals, np.sum(normals * (lines[:, :1] * across), axis=1), corner


def _intersection(edges: tuple[Curve, Curve], lines: Floats) -> Floats | None:
    normals, offsets, corner = _system(edges, lines)
    if abs(float(np.linalg.det(normals))) < 0.2:
        return None
    return corner + np.linalg.solve(normals, offsets)


def _with_covariance(
    edges: tuple[Curve, Curve], lines: Floats, fits: list[EdgeLine], softness: float, growth: list[float]
) -> CornerFit:
    normals, offsets, corner = _system(edges, lines + [fit.bend for fit in fits])
    inverse = np.linalg.inv(normals)
    variance = np.diag([fit.variance for fit in fits])
    extrapolation = inverse @ np.diag(growth) @ inverse.T
    pixel, covariance = corner + inverse @ offsets, inverse @ variance @ inverse.T
    return CornerFit(pixel, covariance, softness, lines, extrapolation, normals, np.zeros((2, 2)))
