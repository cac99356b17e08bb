"""What a person should know before trusting a result, in sentences."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.solver.polish import Fit, distances
from workers.solver.problem import FitProblem
from workers.solver.schedule import State
from workers.solver.uncertainty import Uncertainty

# Relative differences in loss from which two searches, or two stages, have ended in different places.
_SLOTS_DIFFER: Final = 0.02
_STAGES_DIFFER: Final = 0.25
_BASELINE_BETTER: Final = 1e-3


def at_bounds(problem: FitProblem, p: NDArray[np.float64]) -> list[str]:
    """Names of the free parameters that lie on an end of their bounds (within a millionth of the width)."""
    lower, upper = problem.lower, problem.upper
    margin = 1e-6 * (upper - lower)
    return [problem.names[i] for i in problem.free if p[i] <= lower[i] + margin[i] or p[i] >= upper[i] - margin[i]]


def alarms(
    problem: FitProblem,
    state: State,
    ga_px: tuple[float, float],
    polished: Fit,
    plain: Fit,
    spread: Uncertainty,
) -> list[str]:
    """Sentences, the gravest first. ga_px: mean and RMS px of the genetic algorithm's best."""
    p = np.array(polished.parameters)
    found = _data_alarms(problem, p, spread)
    edge = at_bounds(problem, p)
    if edge:
        found.append(
            f"The optimum lies on the edge of the bounds of {', '.join(edge)}: widen them, or lock what is known."
        )
    found += _search_alarms(state, ga_px, polished, plain)
    worst = spread.worst_correlation()
    if worst is not None and abs(worst[2]) > 0.98:
        found.append(
            f"{worst[0]} and {worst[1]} can hardly be told apart (correlation {worst[2]:.3f}): "
            "trust their combination, not each alone; locking one of them fixes the other."
        )
    return found


def _data_alarms(problem: FitProblem, p: NDArray[np.float64], spread: Uncertainty) -> list[str]:
    found: list[str] = []
    forbidden = int(np.count_nonzero(distances(problem, p) >= problem.diagonal_px))
    if forbidden:
        found.append(
            f"{forbidden} pairs lie behind the camera or past the lens model's range, or an image away: "
            "check those marks, the nominal rotation and the model."
        )
    lost = [name for name, std in zip(spread.names, spread.std.tolist(), strict=True) if not np.isfinite(std)]
    if lost:
        found.append(
            f"The pairs do not determine {', '.join(lost)} (rank {spread.rank} of {len(spread.names)}): "
            "mark vertices at other distances and image regions, or lock parameters."
        )
    vague = [
        f"{name} {std:.2f} deg"
        for name, unit, std in zip(spread.names, spread.units, spread.std.tolist(), strict=True)
        if unit == "deg" and np.isfinite(std) and std > 1.0
    ]
    if vague:
        found.append(
            f"The rotation is only known to about {', '.join(vague)} (one standard deviation): "
            "more pairs across the image, or locked intrinsics, make it better."
        )
    return found


def _search_alarms(state: State, ga_px: tuple[float, float], polished: Fit, plain: Fit) -> list[str]:
    found: list[str] = []
    low, high = min(state.slot_losses), max(state.slot_losses)
    if high > low * (1.0 + _SLOTS_DIFFER):
        found.append(
            f"The slots of the last iteration disagree: their losses go from {low:.3f} to {high:.3f} px. "
            "More iterations or generations, or narrower bounds, help."
        )
    if polished.rms_px < ga_px[1] * (1.0 - _STAGES_DIFFER):
        found.append(
            f"The polish lowered the RMS from {ga_px[1]:.3f} to {polished.rms_px:.3f} px: "
            "the genetic algorithm had not come near the optimum, or some pairs are gross outliers."
        )
    if plain.rms_px < polished.rms_px * (1.0 - _BASELINE_BETTER):
        found.append(
            f"Plain least squares from the centre of the bounds ends lower ({plain.rms_px:.3f} px RMS) than the "
            f"search and its polish ({polished.rms_px:.3f} px): run it again with more slots."
        )
    return found
