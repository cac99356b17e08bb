# pyright: reportMissingTypeStubs=false
"""Cameras that read their rows one after the other: what that does to the pairs, and whether residuals show it.

A row is read `line_time_us` after the row above it (below zero: before it). The frame's stamp counts as the moment of
the middle row; the clocks' offset absorbs any other.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import special

from apexcal.documents.precision import RollingShutter
from workers.solver.common_errors import column_of
from workers.solver.estimate import Estimate
from workers.solver.outcomes import SolveError
from workers.solver.problem import FitProblem
from workers.solver.shared_errors import shared_errors
from workers.solver.weighting import whitened

Floats = NDArray[np.float64]
# scipy publishes no types.
_student_quantile: Callable[[float, float], float] = special.stdtrit
_FALSE_ALARMS: Final = 0.005


def at_their_rows(problem: FitProblem) -> FitProblem:
    """The problem with each point (N, 3) where the apex was when its mark's row was read.

    Raises SolveError `no_motion` if a line time is stated and the pairs do not say how the corner moved.
    """
    if problem.line_time_us == 0.0:
        return problem
    if problem.velocities is None:
        raise SolveError(
            "no_motion",
            "The pairs do not say how the corner moved, so nothing follows from line_time_us.",
            "Give stamp_ns of pairs from a walk, or leave line_time_us out.",
        )
    return problem.moved_by(1e-6 * problem.line_time_us * problem.rows_below)


def rolling_shutter(estimate: Estimate) -> RollingShutter | None:
    """Return the shutter that the residuals show; None if the pairs do not determine it or tell no motion.

    What time blocks share, and an estimated clock offset, are estimated beside the line time, because they would
    absorb it otherwise. The offset comes from the same marks, so that its own deviation says nothing here.
    """
    if estimate.errors is None or estimate.holding.velocities is None:
        return None
    problem, p = whitened(estimate.holding, estimate.held_at), estimate.held_at
    column = column_of(problem, p, "line_time_us")
    if not np.any(column[problem.weights > 0.0]):
        return None
    if "clock_ms" in problem.common_errors:
        column = np.concatenate([column_of(problem, p, "clock_ms"), column], axis=2)
    wider = estimate.errors.without("clock_ms").with_columns(column)
    if estimate.plain is not None and problem.blocks is not None and problem.blocks.over_time:
        wider = estimate.plain.without("clock_ms").with_columns(column)
        shared = shared_errors(problem, p, wider)
        wider = shared.errors if shared is not None else wider
    variance, freedom = float(wider.covariance()[-1, -1]), float(wider.freedoms()[-1])
    if not variance > 0.0:
        return None  # the fit's own parameters move the marks alike
    limit = float(_student_quantile(min(max(freedom, 1.0), 1e6), 1.0 - 0.5 * _FALSE_ALARMS))
    line_time_us, std_us = float(wider.step()[-1]), float(np.sqrt(variance))
    is_shown = abs(line_time_us) > limit * std_us
    return RollingShutter(line_time_us=line_time_us, std_us=std_us, limit=limit, shown=is_shown)
