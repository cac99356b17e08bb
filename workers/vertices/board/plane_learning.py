"""The noise of distances, the rings' own errors, and how people turn and lean the board: from planes of near sweeps.

Each distance errs by itself, and all distances of a ring err together. How far points lie off a plane shows the sum;
a one-way analysis of variance by ring separates the two.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from workers.vertices.board.candidate import PlaneCandidate
from workers.vertices.board.candidate_search import find_planes
from workers.vertices.board.holding import learn_slope
from workers.vertices.board.model import BoardModel, Floats
from workers.vertices.board.planes import fit_plane
from workers.vertices.range_image import RangeImage

VARIANCE_RINGS = 3
_DEVIATION = 1.4826  # of a normal variable, over the median of its absolute value


class RangeVariance(NamedTuple):
    """Variances of distances about a plane, square metres.

    Attributes:
        about: of all, robust against their long tails.
        within: the same within the rings.
        between: of the rings' own errors; its estimate may be negative.
        rings: how many.
    """

    about: float
    within: float
    between: float
    rings: int

    def own(self, noise: float) -> float:
        """Return the standard deviation (m) of the rings' own errors, from all points and the noise of each."""
        return math.sqrt(max(self.about - noise**2, 0.0) * self.rings / (self.rings - 2))


def analyse_variance(beyond: Floats, ring: NDArray[np.int64]) -> RangeVariance | None:
    """Return the one-way analysis of variance of points about a plane fitted to them; None on fewer than 3 rings.

    Any two rings lie in one plane, whatever their biases: the plane takes two degrees of freedom of the rings' means.

    Args:
        beyond: (N,) metres by which each point lies behind the plane; ring: (N,).
    """
    count = np.bincount(ring).astype(np.float64)
    counted = (count > 1.0)[ring]
    count = count[count > 1.0]
    rings, points = count.size, float(count.sum())
    if rings < VARIANCE_RINGS:
        return None
    about = (1.05 * _DEVIATION * float(np.median(np.abs(beyond)))) ** 2
    beyond, ring = beyond[counted], np.unique(ring[counted], return_inverse=True)[1]
    mean = np.bincount(ring, beyond) / count
    within = (_DEVIATION * float(np.median(np.abs(beyond - mean[ring])))) ** 2 * points / (points - rings)
    free = rings - 2
    between = float(count @ (mean - beyond.mean()) ** 2) / free
    between /= (1.0 - 2.0 / (9.0 * free)) ** 3  # median of chi-square (Wilson and Hilferty)
    on_each = (points - float(count @ count) / points) / (rings - 1)
    return RangeVariance(about, within, (between - within) / on_each, rings)


ENOUGH = 4  # near sweeps that suffice to learn from
MIN_RINGS = 2
_DEVIATIONS = 4.0  # points farther off a plane do not belong to it
FIRST_SIGMA_M = 0.03
_SIGMA_M = (0.004, 0.08)
_ANY_TILT = (0.0, 0.25)  # boards held on their tip lean by slopes up to 0.7 (real recordings); 2.8 deviations
_LEAST_TILT, _LEAST_YAW = 0.03, 0.1
BIAS_M = 0.015  # data sheets: accuracy 0.03 m, as two standard deviations


def learn_planes(windows: Sequence[RangeImage], model: BoardModel) -> tuple[BoardModel, list[PlaneCandidate]]:
    """Return the model with the noise of distances and the usual slopes of the board, and the candidates used."""
    candidates = likeliest_candidates(windows, model)
    noise = _noise(candidates)
    default = BoardModel(model.grid)
    model = replace(model, sigma=_clip(noise), dropout_rate=_dropout_rate(candidates, default.dropout_rate))
    for _ in range(3):
        candidates = likeliest_candidates(windows, model)
        if len(candidates) < ENOUGH:
            return model, candidates
        upper = [_upper_plane_fit(candidate, model) for candidate in candidates]
        # A surface with a larger spread is no plane.
        about = [part[2] for part in upper if part[2] is not None and part[2].own(noise) < _SIGMA_M[1]]
        spread = rings = bias = 0.0
        if len(about) >= ENOUGH:
            # The spread about the plane includes the rings' differences; the second differences do not.
            spread = float(np.median([part.own(noise) for part in about]))
            within = float(np.median([part.within for part in about]))
            rings = math.sqrt(max(float(np.median([part.between for part in about])), 0.0))
            # A bend of the board is an error that neighbours share, too.
            bias = math.hypot(math.sqrt(max(within - noise**2, 0.0)), rings)
        if sum(candidate.plane.extent.has_many_rings for candidate in candidates) < ENOUGH:
            # On few rings a plane may have met the body, too.
            spread, rings, bias = (min(value, BIAS_M) for value in (spread, rings, bias))
        slopes, variances = (np.array([part[k] for part in upper]) for k in (0, 1))
        turn = learn_slope(slopes[:, 0], variances[:, 0], default.yaw, default.yaw, _LEAST_YAW)
        model = replace(
            model,
            sigma=_clip(math.hypot(noise, spread)),
            ring_bias=rings,
            bias=bias,
            tilt=learn_slope(slopes[:, 1], variances[:, 1], _ANY_TILT, default.tilt, _LEAST_TILT),
            yaw=(0.0, max(2.0 * turn[1], 0.2)),
        )
    return model, likeliest_candidates(windows, model)


def learn_scattered(windows: Sequence[RangeImage], model: BoardModel) -> BoardModel:
    """Return the model with the noise of a sensor without rings: the spread of its points about planes."""
    spreads: list[float] = []
    for candidate in likeliest_candidates(windows, model):
        window = candidate.window
        beyond = _beyond(window.azimuth[0], window.slope[0], window.distance[0], candidate.plane.w)
        near = window.inside[0] & (np.abs(beyond) < _DEVIATIONS * model.sigma)
        spreads.append(_DEVIATION * float(np.median(np.abs(beyond[near]))))
    sigma = _clip(float(np.median(spreads))) if spreads else model.sigma
    return replace(model, sigma=sigma, tilt=_ANY_TILT, bias=BIAS_M)


def _upper_plane_fit(candidate: PlaneCandidate, model: BoardModel) -> tuple[Floats, Floats, RangeVariance | None]:
    """Return the plane's two slopes, their variances, and the variance of distances about it.

    It is fitted to the rings that are nearly as wide as the widest; where these are few, to the next above them, too.
    Farther down a ring may have met the body, and farther up a head: both are only centimetres behind the board.
    """
    window, ends = candidate.window, candidate.ends
    rings = np.flatnonzero(ends[:, 0] >= 0)
    width = {r: abs(window.azimuth[r, ends[r, 1]] - window.azimuth[r, ends[r, 0]]) for r in rings}
    widest = max(rings, key=lambda r: width[r])
    wide = [r for r in rings if width[r] > 0.6 * width[widest]]
    above = [r for r in rings if r > widest and r not in wide]
    chosen = [*wide, *above[: max(VARIANCE_RINGS - len(wide), 0)]]
    runs = [(r, slice(ends[r, 0], ends[r, 1] + 1)) for r in chosen]
    azimuth, slope, distance = (
        np.concatenate([part[run] for run in runs]) for part in (window.azimuth, window.slope, window.distance)
    )
    on_it = np.abs(_beyond(azimuth, slope, distance, candidate.plane.w)) < _DEVIATIONS * model.sigma
    azimuth, slope, distance = azimuth[on_it], slope[on_it], distance[on_it]
    prior = np.array([*BoardModel(model.grid).yaw, *_ANY_TILT])
    w, info = fit_plane(azimuth, slope, distance, np.ones(distance.size), model.sigma, prior)
    towards = np.column_stack([w[1:] / w[0] ** 2, -np.eye(2) / w[0]])
    variances: Floats = np.asarray(np.diag(towards @ np.linalg.inv(info) @ towards.T), np.float64)
    ring = np.repeat(np.arange(len(runs)), [run.stop - run.start for _, run in runs])[on_it]
    return -w[1:] / w[0], variances, analyse_variance(_beyond(azimuth, slope, distance, w), ring)


def _beyond(azimuth: Floats, slope: Floats, distance: Floats, w: Floats) -> Floats:
    """Return horizontal metres by which points lie behind a plane."""
    return distance - 1.0 / (w[0] * np.cos(azimuth) + w[1] * np.sin(azimuth) + w[2] * slope)


def likeliest_candidates(windows: Sequence[RangeImage], model: BoardModel) -> list[PlaneCandidate]:
    """Return each window's likeliest candidate, if at least two rings meet it."""
    candidates = [candidate for window in windows for candidate in find_planes([window], model, 1)]
    return [c for c in candidates if c.plane.extent.rings >= MIN_RINGS or model.grid.scattered]


def _runs(candidate: PlaneCandidate) -> list[Floats]:
    """Return the distances along the board's part of every ring, 0 where nothing came back."""
    ends = enumerate(candidate.ends.tolist())
    return [candidate.window.distance[r, first : last + 1] for r, (first, last) in ends if first >= 0]


def _noise(candidates: Sequence[PlaneCandidate]) -> float:
    """Return the noise (m) by second differences along the rings, which a plane and a slow bend do not change."""
    runs = [run for candidate in candidates for run in _runs(candidate)]
    second = np.concatenate([np.zeros(0), *(np.diff(run[run > 0.0], 2) for run in runs)])
    return 1.4826 * float(np.median(np.abs(second))) / math.sqrt(6.0) if second.size else FIRST_SIGMA_M


def _dropout_rate(candidates: Sequence[PlaneCandidate], default: float) -> float:
    """Return the share of rays on the board without a return; a hundred imagined rays at the default count, too."""
    runs = [run for candidate in candidates for run in _runs(candidate)]
    missing, rays = sum(int(np.count_nonzero(run == 0.0)) for run in runs), sum(run.size for run in runs)
    return max((missing + 100.0 * default) / (rays + 100.0), default)


def _clip(sigma: float) -> float:
    return min(max(sigma, _SIGMA_M[0]), _SIGMA_M[1])
