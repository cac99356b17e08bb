"""Predicts in sentences what a fit of planned vertices would determine, before anyone has walked."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.solver.problem import FitProblem
from workers.solver.uncertainty import Uncertainty, plan_uncertainty

# The groups people ask for, in their words; of each the largest deviation counts. Turns are about the camera's axes.
_ASKED: Final[tuple[tuple[str, tuple[str, ...]], ...]] = (
    ("yaw", ("rotation_y",)),
    ("pitch", ("rotation_x",)),
    ("roll", ("rotation_z",)),
    ("any rotation", ("alpha", "beta", "gamma")),
    ("the camera's place", ("t_x", "t_y", "t_z")),
    ("the focal lengths", ("f_x", "f_y")),
    ("the principal point", ("c_x", "c_y")),
)


def plan_sentences(problem: FitProblem, p: NDArray[np.float64], sigma_px: float | None = None) -> list[str]:
    """What a fit of these planned vertices would give, one standard deviation: degrees, millimetres, pixels.

    Arguments as of `uncertainty.plan_uncertainty`: points (N, 3) m in the LiDAR's frame, p (D,) the parameters as far
    as they are known. A first sentence says what would be known, another what would not.
    """
    spread = plan_uncertainty(problem, p, sigma_px)
    std = dict(zip(spread.names, spread.std.tolist(), strict=True))
    count = int(np.count_nonzero(problem.weights))
    known, lost = _known(spread, std)
    if spread.rank == 0:
        return [f"These {count} vertices would determine nothing: the camera does not see them."]
    found = [f"These {count} vertices would give {_listed(known)} (one standard deviation)."] if known else []
    if lost:
        found.append(
            f"These {count} vertices would not determine {_listed(lost)}: plan some at other distances and heights "
            "too, or lock what is known of the lens."
        )
    return found


def _known(spread: Uncertainty, std: dict[str, float]) -> tuple[list[str], list[str]]:
    unit = dict(zip(spread.names, spread.units, strict=True))
    known: list[str] = []
    lost: list[str] = []
    for words, names in _ASKED:
        asked = [name for name in names if name in std]
        if not asked:
            continue
        worst = max(std[name] for name in asked)
        if np.isfinite(worst):
            known.append(f"{words} to {_amount(worst, unit[asked[0]])}")
        else:
            lost.append(words)
    return known, lost


def _amount(std: float, unit: str) -> str:
    value, name = (1000.0 * std, "mm") if unit == "m" else (std, {"deg": "degrees", "px": "px"}[unit])
    return f"{_two_digits(value)} {name}"


def _two_digits(value: float) -> str:
    # As people write it: never with an exponent.
    digits = 1 - int(np.floor(np.log10(value))) if value > 0.0 else 0
    return f"{round(value, digits):.{max(digits, 0)}f}"


def _listed(parts: Sequence[str]) -> str:
    return " and ".join(filter(None, [", ".join(parts[:-1]), parts[-1]]))
