"""What a person should know before trusting a result, in sentences."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.results import Outlier
from workers.solver.degeneracy import is_determined, parameter_alarms, point_alarms
from workers.solver.optima import MOST_SLOTS, optimum_alarms, other_optima
from workers.solver.polish import Fit, distances
from workers.solver.problem import FitProblem
from workers.solver.schedule import State
from workers.solver.uncertainty import Uncertainty

# Relative differences in loss from which two searches, or two stages, have ended in different places.
_SLOTS_DIFFER: Final = 0.02
_SLOTS_DIFFER_PX: Final = 0.01
_STAGES_DIFFER: Final = 0.25
_STAGES_DIFFER_PX: Final = 0.05
_BASELINE_BETTER: Final = 1e-3
_EXACT_PX: Final = 1e-4
_MANY: Final = 0.4
# Share of the image's diagonal: no marking, and no lens model that is roughly right, leaves half of the pairs there.
_UNEXPLAINED: Final = 0.015
# Scale of the stated covariances from which they, or the model, are wrong; what a few pairs show by chance is below.
_UNDERSTATED: Final = 1.5


def at_bounds(problem: FitProblem, p: NDArray[np.float64]) -> list[str]:
    """Names of the free parameters that lie on an end of their bounds (within a millionth of the width)."""
    lower, upper = problem.lower, problem.upper
    margin = 1e-6 * (upper - lower)
    free = [i for i in problem.free.tolist() if i > 2 or not problem.any_rotation]
    return [problem.names[i] for i in free if p[i] <= lower[i] + margin[i] or p[i] >= upper[i] - margin[i]]


def misfit(problem: FitProblem, p: NDArray[np.float64]) -> list[str]:
    """A sentence where half of the pairs lie further off than any marking explains: then it is no calibration."""
    middle = float(np.median(distances(problem, p)[problem.weights > 0.0]))
    if middle <= _UNEXPLAINED * problem.diagonal_px:
        return []
    return [
        f"Half of the pairs lie more than {middle:.0f} px from where this calibration puts them: it does not explain "
        "them. Check what is locked, the order and signs of u and v, the image size, and that frames and marks are "
        "of this camera."
    ]


def alarms(
    problem: FitProblem,
    ga_px: tuple[float, float],
    polished: Fit,
    elsewhere: list[str],
    spread: Uncertainty,
    outliers: list[Outlier],
    excluded: bool,
) -> list[str]:
    """Sentences, the gravest first.

    ga_px: mean and RMS px of the genetic algorithm's best over the problem's pairs; elsewhere: what `several_optima`
    says; outliers: as judged, and whether the fit left them out.
    """
    p = np.array(polished.parameters)
    of_points = point_alarms(problem, p)
    found = of_points + parameter_alarms(problem, p, spread)
    edge = at_bounds(problem, p)
    if edge:
        found.append(
            f"The optimum lies on the edge of the bounds of {', '.join(edge)}: widen them, or lock what is known."
        )
    if spread.noise_scale is not None and spread.noise_scale > _UNDERSTATED:
        found.append(
            f"The residuals are {spread.noise_scale:.1f} times what vertices and marks state of their errors, and "
            "the standard deviations are scaled by that: marks or times are worse than stated, or the model is wrong."
        )
    if not of_points and spread.rank == len(spread.names):
        # Points without extent allow many fits, and any pair would be named.
        found += _outlier_alarms(problem, outliers, excluded)
    return found + elsewhere + _search_alarms(ga_px, polished)


def _outlier_alarms(problem: FitProblem, outliers: list[Outlier], excluded: bool) -> list[str]:
    if not outliers:
        return []
    # How many and not which: everybody who sees the calibration sees alarms, only reviewers see the outliers.
    which = "1 pair does" if len(outliers) == 1 else f"{len(outliers)} pairs do"
    what = (
        "were left out" if excluded else "are in the fit; to leave them out: outliers: exclude, or --outliers exclude"
    )
    found = [f"{which} not belong; the outliers name them. They {what}. Check their marks and their frames' times."]
    pairs = np.count_nonzero(problem.weights) + excluded * len(outliers)
    if len(outliers) > _MANY * pairs:
        found.append(
            f"{len(outliers)} of {pairs} pairs do not belong to the fit, too many to "
            "trust it. Look at the marks, the pairing of frames, and the model."
        )
    return found


def several_optima(
    problem: FitProblem, state: State, polished: Fit, plain: dict[str, tuple[Fit, float]], spread: Uncertainty
) -> list[str]:
    """Sentences where slots, or search and baselines, ended in different places: there may be another optimum.

    plain: each baseline with its cost relative to the polished one's, by the words that name it.
    """
    found: list[str] = []
    if is_determined(problem, np.array(polished.parameters), spread):
        ends = [*state.first_slot_parameters[:MOST_SLOTS], *(fit.parameters for fit, _ in plain.values())]
        found += optimum_alarms(problem, polished, other_optima(problem, polished, ends))
    low, high = min(state.slot_losses), max(state.slot_losses)
    if high > low + max(_SLOTS_DIFFER * low, _SLOTS_DIFFER_PX):
        found.append(
            f"The slots of the last iteration disagree: their losses go from {low:.3f} to {high:.3f} px. "
            "There may be several optima; more iterations or generations, or narrower bounds, help."
        )
    for words, (fit, relative_cost) in plain.items():
        if relative_cost < 1.0 - _BASELINE_BETTER and fit.rms_px < polished.rms_px - _EXACT_PX:
            found.append(
                f"{words} ends lower ({fit.rms_px:.3f} px RMS) than the search and its polish "
                f"({polished.rms_px:.3f} px): run it again with more slots."
            )
    return found


def _search_alarms(ga_px: tuple[float, float], polished: Fit) -> list[str]:
    # Below what a mark can be placed to, a share of the error says nothing of where the search ended.
    if polished.rms_px >= ga_px[1] * (1.0 - _STAGES_DIFFER) or ga_px[1] - polished.rms_px < _STAGES_DIFFER_PX:
        return []
    return [
        f"The polish lowered the RMS from {ga_px[1]:.3f} to {polished.rms_px:.3f} px: "
        "the genetic algorithm had not come near the optimum, or some pairs are gross outliers."
    ]
