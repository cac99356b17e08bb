"""Where a fit ended: on its bounds, far from its pairs, or beside another optimum."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.solver.degeneracy import is_determined
from workers.solver.optima import MOST_SLOTS, optimum_sentences, other_optima
from workers.solver.polish import Fit, distances
from workers.solver.problem import FitProblem
from workers.solver.schedule import State
from workers.solver.uncertainty import Uncertainty

_BASELINE_BETTER: Final = 1e-3
_EXACT_PX: Final = 1e-4
# Share of the image's diagonal: no marking, and no lens model that is roughly right, leaves half of the pairs there.
_UNEXPLAINED: Final = 0.015


def at_bounds(problem: FitProblem, p: NDArray[np.float64]) -> list[str]:
    """Names of the free parameters that lie on an end of their bounds (within a millionth of the width)."""
    lower, upper = problem.lower, problem.upper
    margin = 1e-6 * (upper - lower)
    free = [i for i in problem.free.tolist() if i > 2 or not problem.any_rotation]
    return [problem.names[i] for i in free if p[i] <= lower[i] + margin[i] or p[i] >= upper[i] - margin[i]]


def misfit(problem: FitProblem, p: NDArray[np.float64]) -> str | None:
    """A sentence where half of the pairs lie further off than any marking explains: then it is no calibration."""
    middle = float(np.median(distances(problem, p)[problem.weights > 0.0]))
    if middle <= _UNEXPLAINED * problem.diagonal_px:
        return None
    return f"Half of the pairs lie more than {middle:.0f} px from where this calibration puts them."


def several_optima(
    problem: FitProblem, state: State, polished: Fit, plain: dict[str, tuple[Fit, float]], spread: Uncertainty
) -> list[str]:
    """Sentences where slots, or search and baselines, ended in different places: there may be another optimum.

    plain: each baseline with its cost relative to the polished one's, by the words that name it.
    """
    found: list[str] = []
    if is_determined(problem, np.array(polished.parameters), spread):
        starts, ends = state.first_slot_parameters[:MOST_SLOTS], [fit for fit, _ in plain.values()]
        found += optimum_sentences(problem, polished, other_optima(problem, polished, starts, ends))
    for words, (fit, relative_cost) in plain.items():
        if relative_cost < 1.0 - _BASELINE_BETTER and fit.rms_px < polished.rms_px - _EXACT_PX:
            found.append(
                f"{words} ends lower ({fit.rms_px:.3f} px RMS) than the search and its polish "
                f"({polished.rms_px:.3f} px)."
            )
    return found
