"""Weak priors on distortion that the pairs hardly determine.

Without them a coefficient of a narrow walk runs to its bound. They apply only to coefficients that the request leaves
free, and only if the pairs determine one less well than its prior. Otherwise the fit has none.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.solver.problem import FitProblem
from workers.solver.uncertainty import Uncertainty

Floats = NDArray[np.float64]
_LARGEST: Final = 0.2
_AT_CORNER: Final = 0.3
"""One standard deviation of a term: this share of the radius at the image's corner, at most 0.2. Decision 0044
has the measurement."""
_DECENTRED: Final = 0.1
"""Tangential terms are the first radial one of a lens off its axis by this share of the corner's radius
(Conrady 1919)."""
_RADIAL: Final = {
    "pinhole": {},
    "brown_conrady": {"k1": 1, "k2": 2, "k5": 3},
    "kannala_brandt": {"k1": 1, "k2": 2, "k3": 3, "k4": 4},
}
_TANGENTIAL: Final = {"brown_conrady": ("k3", "k4")}


def lens_priors(problem: FitProblem, p: Floats, spread: Uncertainty) -> dict[str, float]:
    """Standard deviations about zero, by coefficient, for a fit that ended at p (D,) with these deviations.

    Empty if the pairs determine all coefficients or leave other parameters open, or if the request constrains all
    coefficients.
    """
    corner = 0.5 * problem.diagonal_px / float(np.sqrt(p[6] * p[7]))
    sigmas = {name: _radial(corner, order) for name, order in _RADIAL[problem.model].items()}
    for name in _TANGENTIAL.get(problem.model, ()):
        sigmas[name] = _DECENTRED * corner * _radial(corner, 1)
    std = dict(zip(spread.names, spread.std.tolist(), strict=True))
    open_names = [name for name in sigmas if name in problem.unstated and name in std]
    if not all(np.isfinite(one) for name, one in std.items() if name not in open_names):
        return {}  # no prior of the lens helps other open parameters
    # The bounds are five of the largest deviation away: a coefficient better determined than its prior stays inside.
    if all(std[name] < sigmas[name] for name in open_names):
        return {}
    return {name: sigmas[name] for name in open_names}


def _radial(corner: float, order: int) -> float:
    return min(_LARGEST, _AT_CORNER / corner ** (2 * order))
