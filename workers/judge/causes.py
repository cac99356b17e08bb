"""Causes of residuals as rivals: clock, rolling shutter and lens model, fitted together.

Each is a few more unknowns of the fit. One after the other is chosen by what it explains (forward selection; Akaike
1974), and stays in the fit while the rest are tested. So a cause is named only if its rivals explain less.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from workers.judge.effects import Effect, PointsOfUse
from workers.judge.residual_patterns import PatternTest, pattern_test
from workers.judge.topics import LOOK_RATE
from workers.solver.estimate import Estimate
from workers.solver.problem import FitProblem
from workers.solver.residuals import by_point, predict

Floats = NDArray[np.float64]
CLOCK: Final = "clock"
SHUTTER: Final = "rolling_shutter"
LENS: Final = "lens_model"
# Radial patterns up to the seventh power of the distance from the centre: the lens models' own terms go that far.
_POWERS: Final = (1, 2, 3, 4, 5, 6, 7)


class Finding(NamedTuple):
    """A cause in the fit beside all others that are named: its test, its effect, and whether it is named itself.

    ``rivals``: the named causes that it was tested beside; ``columns`` (N, 2, e): how the pixels change with it.
    """

    test: PatternTest
    effect: Effect
    is_named: bool
    rivals: tuple[str, ...]
    columns: Floats

    @property
    def is_told(self) -> bool:
        """Whether the pairs tell it at all: two deviations of it do no more to points of use than is allowed."""
        return bool(np.all(np.isfinite(self.test.deviations))) and 2.0 * self.effect.per_deviation <= 1.0


def find_causes(estimate: Estimate) -> dict[str, Finding]:
    """Return what the residuals say of each cause that the pairs can show; empty if the result states no errors."""
    if estimate.errors is None or estimate.plain is None:
        return {}
    columns = _columns(estimate)
    named: list[str] = []
    tests: dict[str, PatternTest] = {}
    while True:
        rest = [name for name in columns if name not in named]
        tests = {name: _test(estimate, columns, name, named) for name in rest}
        shown = [name for name in rest if tests[name].probability < LOOK_RATE]
        if not shown:
            break
        named.append(max(shown, key=lambda name: tests[name].evidence))
    points = PointsOfUse(estimate)
    findings: dict[str, Finding] = {}
    for name in columns:
        rivals = [each for each in named if each != name]
        test = tests[name] if name in tests else _test(estimate, columns, name, rivals)
        by_unknowns = points.by_parameters @ test.parameters
        if name == LENS:
            by_unknowns = by_unknowns + lens_patterns(points.problem, estimate.held_at)
        # What the fit's own parameters do alike has no end; it is no error of the result.
        covariance = np.where(np.isfinite(test.covariance), test.covariance, 0.0)
        effect = points.effect(by_unknowns, test.values, covariance)
        findings[name] = Finding(test, effect, name in named, tuple(rivals), columns[name])
    return findings


def _columns(estimate: Estimate) -> dict[str, Floats]:
    problem, p = estimate.holding, estimate.held_at
    columns = {LENS: np.nan_to_num(lens_patterns(problem, p))}
    if problem.velocities is not None:
        moved = image_velocities(estimate)
        columns[CLOCK] = moved[:, :, None]
        columns[SHUTTER] = 1e-6 * problem.rows_below[:, None, None] * moved[:, :, None]
    return {name: each for name, each in columns.items() if np.any(each[problem.weights > 0.0])}


def _test(estimate: Estimate, columns: dict[str, Floats], name: str, rivals: list[str]) -> PatternTest:
    # A clock offset that is only estimated is always a rival.
    is_unsure = name != CLOCK and CLOCK in columns and "clock_ms" in estimate.holding.common_errors
    beside = [columns[each] for each in columns if each in rivals or (each == CLOCK and is_unsure)]
    joined = np.concatenate(beside, axis=2) if beside else None
    replaces_clock = CLOCK in rivals or is_unsure
    test = pattern_test(estimate, columns[name], joined, "clock_ms" if replaces_clock else "")
    assert test is not None
    return test


def lens_patterns(problem: FitProblem, p: Floats) -> Floats:
    """(N, 2, 9) shifts by radial terms and by the two of decentring (Conrady 1919), about 1 px at the corner."""
    pixels, violation = predict(problem, p)
    away = np.where((violation > 0.0)[:, None], 0.0, pixels - p[8:10]) / (0.5 * problem.diagonal_px)
    x, y = away.T
    square = x * x + y * y
    radial = [np.sqrt(square) ** (power - 1) for power in _POWERS]
    along = away[:, :, None] * np.stack(radial, axis=1)[:, None, :]
    decentred = [[square + 2.0 * x * x, 2.0 * x * y], [2.0 * x * y, square + 2.0 * y * y]]
    return np.concatenate([along, np.array(decentred).T], axis=2)


def image_velocities(estimate: Estimate) -> Floats:
    """(N, 2) velocity of each pair's projection, px/s; zero where there is none."""
    problem = estimate.holding
    assert problem.velocities is not None
    _, violation = predict(problem, estimate.held_at)
    moved = np.einsum("nij,nj->ni", by_point(problem, estimate.held_at), problem.velocities)
    return np.where((violation > 0.0)[:, None], 0.0, moved)
