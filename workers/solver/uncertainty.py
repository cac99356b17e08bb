"""How well the pairs determine each parameter: covariance from the Jacobian at the optimum."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from workers.solver.polish import weighted_residuals
from workers.solver.problem import ANGLES, FitProblem

Floats = NDArray[np.float64]
_ROTATION_AXES: Final = ("rotation_x", "rotation_y", "rotation_z")
# Smallest singular value, relative to the largest of the Jacobian with columns of unit length, that still counts:
# below it two parameters do the same to eight digits.
_RANK_TOLERANCE: Final = 1e-8


@dataclass(frozen=True)
class Uncertainty:
    """Of the free parameters, in people's units (degrees, metres, pixels).

    names, units and std (F,) and covariance (F, F). std is infinite where the pairs do not determine the
    parameter. Rotations are small turns about the camera's axes at the solution, which have no singular point;
    only where one of the search's rotation parameters is locked or has a prior are they the search's own.
    rank is that of the Jacobian; sigma_px the noise per pixel coordinate that the residuals show.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    std: Floats
    covariance: Floats
    rank: int
    sigma_px: float

    @property
    def correlation(self) -> Floats:
        """(F, F); 0 where a standard deviation is infinite or zero."""
        good = np.isfinite(self.std) & (self.std > 0.0)
        inverse = np.zeros_like(self.std)
        inverse[good] = 1.0 / self.std[good]
        return self.covariance * inverse[:, None] * inverse[None, :]

    def worst_correlation(self) -> tuple[str, str, float] | None:
        """The two parameters that can be told apart least, and their correlation."""
        if len(self.names) < 2:
            return None
        strict = np.triu(np.abs(self.correlation), 1)
        i, j = np.unravel_index(int(np.argmax(strict)), strict.shape)
        return self.names[i], self.names[j], float(self.correlation[i, j])

    def to_document(self) -> dict[str, Any]:
        """JSON form, an infinite standard deviation as null."""
        worst = self.worst_correlation()
        return {
            "std": {n: s if np.isfinite(s) else None for n, s in zip(self.names, self.std.tolist(), strict=True)},
            "covariance": {
                "names": list(self.names),
                "units": list(self.units),
                "matrix": self.covariance.tolist(),
            },
            "worst_correlation": None if worst is None else {"pair": [worst[0], worst[1]], "value": worst[2]},
            "sigma_px": self.sigma_px,
            "rank": self.rank,
        }


def uncertainty(problem: FitProblem, p: Floats) -> Uncertainty:
    """Covariance sigma^2 (J^T J)^-1 of the free parameters at p (D,), sigma^2 from the residuals.

    With the priors' rows in J. Holds for marks with independent errors of one size, and says nothing about a
    systematic error of the marks or the vertices.
    """
    free = problem.free
    local = not any(name in problem.priors or name in problem.locked for name in problem.names[:3]) and bool(
        np.all(np.isin((0, 1, 2), free))
    )
    residuals, J = weighted_residuals(problem, p, local)
    indices: list[int] = free.tolist()
    names = tuple(_ROTATION_AXES[i] if local and i < 3 else problem.names[i] for i in indices)
    count = 2 * int(np.count_nonzero(problem.weights)) + len(problem.priors) - len(free)
    sigma = float(np.sqrt(residuals @ residuals / count)) if count > 0 else problem.mark_sigma_px
    lengths = np.linalg.norm(J, axis=0)
    lengths[lengths == 0.0] = 1.0
    _, s, Vt = np.linalg.svd(J / lengths, full_matrices=False)
    kept = s > _RANK_TOLERANCE * s[0] if s.size else s > 0.0
    half = (Vt[kept] / s[kept, None]) / lengths * sigma
    unit = np.array([np.degrees(1.0) if name in ANGLES else 1.0 for name in names])
    covariance = (half.T @ half) * unit[:, None] * unit[None, :]
    std = np.sqrt(np.diag(covariance))
    # A parameter that takes part in an undetermined direction is not known at all.
    std[np.any(np.abs(Vt[~kept]) > 1e-3, axis=0)] = np.inf
    return Uncertainty(
        names, tuple(unit_of(name) for name in names), std, covariance, int(np.count_nonzero(kept)), sigma
    )


def unit_of(name: str) -> str:
    """The unit people read that parameter in: deg, m, px, or 1."""
    if name in ANGLES:
        return "deg"
    if name.startswith("t_"):
        return "m"
    return "px" if name in ("f_x", "f_y", "c_x", "c_y") else "1"
