"""Looks for other optima nearly as deep, from where the search's slots and the baselines ended."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.checks import figure
from apexcal.geometry.rotations import vector_from_rotation
from workers.solver.polish import Fit, cost_of, polish, weighted_residuals
from workers.solver.problem import FitProblem
from workers.solver.residuals import transform_of
from workers.solver.uncertainty import uncertainty
from workers.solver.weighting import whitened

Floats = NDArray[np.float64]
MOST_SLOTS: Final = 6
"""Slots of the first iteration that are followed; a descent takes some milliseconds."""
_EXACT_PX: Final = 1e-3
_NEARLY_AS_DEEP: Final = 1.25
"""Ratio of root costs up to which marks and models of this kind hardly prefer one optimum."""
_ELSEWHERE_SIGMAS: Final = 5.0
"""Distance, root mean square over the parameters in standard deviations, from which another end is another place."""


def other_optima(
    problem: FitProblem, polished: Fit, starts: Iterable[tuple[float, ...]], ends: Iterable[Fit] = ()
) -> list[Fit]:
    """Fits that ended far from `polished` and nearly as low, the lowest first, one for each place.

    starts: parameter vectors (D,) to descend from, such as the bests of the first iteration's slots, each of which
    looked in the whole bounds; ends: further fits of the problem. Depths count under the weights at the polished fit,
    distances in its standard deviations. None where the pairs leave a direction open: the ends of such a valley are
    one place, however far apart.
    """
    best = np.array(polished.parameters)
    if uncertainty(problem, best).rank < len(problem.free):
        return []
    here = whitened(problem, best)
    J = weighted_residuals(here, best)[1]
    freedom = max(2 * int(np.count_nonzero(problem.weights)) - len(problem.free), 1)
    sigma = max(float(np.sqrt(polished.cost / freedom)), _EXACT_PX)
    places: list[tuple[float, Fit]] = []
    # A descent from the polished fit's own place would end there.
    elsewhere = [start for start in starts if _apart(problem, J, sigma, start, polished.parameters)]
    for fit in (*(polish(replace(here, covariances=None), start) for start in elsewhere), *ends):
        cost = cost_of(here, fit.parameters, polished.scale_px)
        # A descent that ran out of steps has not reached its optimum, which may be this one.
        if not fit.outcome.converged:
            continue
        if cost > _NEARLY_AS_DEEP**2 * polished.cost or not _apart(
            problem, J, sigma, fit.parameters, polished.parameters
        ):
            continue
        if all(_apart(problem, J, sigma, fit.parameters, other.parameters) for _, other in places):
            places.append((cost, fit))
    return [fit for _, fit in sorted(places, key=lambda optimum: optimum[0])]


def optimum_sentences(problem: FitProblem, polished: Fit, others: list[Fit]) -> list[str]:
    """A sentence for each other optimum: how deep, and how far off the camera it says."""
    here = transform_of(problem, np.array(polished.parameters))
    sentences: list[str] = []
    for other in others:
        there = transform_of(problem, np.array(other.parameters))
        turn = float(np.degrees(np.linalg.norm(vector_from_rotation(there.R @ here.R.T))))
        moved = float(np.linalg.norm(there.inverse().t - here.inverse().t))
        sentences.append(
            f"A camera turned by {figure(turn)} degrees and moved by {figure(moved)} m fits nearly as well "
            f"({other.mean_px:.2f} px mean, {other.rms_px:.2f} px RMS, against {polished.mean_px:.2f} and "
            f"{polished.rms_px:.2f}). The pairs do not decide between them."
        )
    return sentences


def _apart(problem: FitProblem, J: Floats, sigma: float, p: Sequence[float], q: Sequence[float]) -> bool:
    step = (np.array(p) - np.array(q))[problem.free]
    return bool(np.linalg.norm(J @ step) > _ELSEWHERE_SIGMAS * sigma * np.sqrt(len(step)))
