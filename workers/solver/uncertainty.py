# pyright: reportMissingTypeStubs=false
"""The uncertainty of each parameter: covariance from the Jacobian at the optimum."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import special

from apexcal.documents.camera_models import ANGLES
from apexcal.documents.precision import Covariance, FitPrecision, Precision, WorstCorrelation
from workers.solver.polish import weighted_residuals
from workers.solver.problem import FitProblem
from workers.solver.weighting import whitened

Floats = NDArray[np.float64]
# scipy publishes no types.
_student_quantile: Callable[[float, float], float] = special.stdtrit
_student: Callable[[float, float], float] = special.stdtr
_NEGLIGIBLE: Final = 1e-6
_HALVINGS: Final = 40
_ROTATION_AXES: Final = ("rotation_x", "rotation_y", "rotation_z")
# Smallest singular value, relative to the largest of the Jacobian with columns of unit length, that still counts:
# below it two parameters do the same to eight digits.
_RANK_TOLERANCE: Final = 1e-8


@dataclass(frozen=True)
class Uncertainty:
    """The uncertainty of the free parameters, in people's units (degrees, metres, pixels).

    names, units and std (F,) and covariance (F, F). std is infinite where the pairs do not determine the
    parameter. Rotations are small turns about the camera's axes at the solution, which have no singular point;
    only where one of the search's rotation parameters is locked or has a prior are they the search's own.
    rank and condition are those of the Jacobian with columns of unit length (infinite where the rank is not full);
    sigma_px the noise per pixel coordinate that the residuals show (or that was planned), by `freedom` degrees of
    freedom; noise_scale that relative to what the pairs' covariances state, where they state any. undetermined: for
    each direction that the data leaves open, its largest parts {name: share}. freedoms (F,): of each variance, where
    several estimates make it. shift (F,): what pairs that do not belong moved the parameters by; std has it, too.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    std: Floats
    covariance: Floats
    rank: int
    sigma_px: float
    condition: float = 1.0
    freedom: float | None = None
    undetermined: tuple[dict[str, float], ...] = ()
    noise_scale: float | None = None
    freedoms: Floats | None = None
    shift: Floats | None = None

    @property
    def correlation(self) -> Floats:
        """(F, F); 0 where a standard deviation is infinite or zero."""
        good = np.isfinite(self.std) & (self.std > 0.0)
        inverse = np.zeros_like(self.std)
        inverse[good] = 1.0 / self.std[good]
        return self.covariance * inverse[:, None] * inverse[None, :]

    @property
    def half_width95(self) -> Floats:
        """Half widths (F,) of the 95 % intervals: Student's t where sigma was estimated, else the normal's."""
        if self.freedoms is not None:
            shift = np.zeros(len(self.std)) if self.shift is None else self.shift
            each = zip(self.std.tolist(), shift.tolist(), self.freedoms.tolist(), strict=True)
            return np.array([_half_width95(*interval) for interval in each])
        return _factor95(self.freedom) * self.std

    def worst_correlation(self) -> WorstCorrelation | None:
        """The two parameters that can be told apart least, and their correlation; None where no two correlate."""
        strict = np.triu(np.abs(self.correlation), 1)
        if not np.any(strict):
            return None
        i, j = np.unravel_index(int(np.argmax(strict)), strict.shape)
        return WorstCorrelation(pair=[self.names[i], self.names[j]], value=float(self.correlation[i, j]))

    def precision(self) -> Precision:
        """The document of what the pairs tell; an infinite standard deviation is null."""
        return Precision(
            std=self._finite(self.std),
            interval95_half_width=self._finite(self.half_width95),
            covariance=Covariance(names=list(self.names), units=list(self.units), matrix=self.covariance.tolist()),
            sigma_px=self.sigma_px,
        )

    def fit_precision(self) -> FitPrecision:
        """The whole document, an infinite condition as null."""
        return FitPrecision(
            **dict(self.precision()),
            correlation=self.correlation.tolist(),
            worst_correlation=self.worst_correlation(),
            noise_scale=self.noise_scale,
            rank=self.rank,
            condition=self.condition if np.isfinite(self.condition) else None,
            undetermined=list(self.undetermined),
            degrees_of_freedom=None if self.freedoms is None else self._finite(self.freedoms),
        )

    def _finite(self, values: Floats) -> dict[str, float | None]:
        return {n: v if np.isfinite(v) else None for n, v in zip(self.names, values.tolist(), strict=True)}


def _factor95(freedom: float | None) -> float:
    return 1.959963984540054 if freedom is None else float(_student_quantile(max(freedom, 1), 0.975))


def _half_width95(std: float, shift: float, freedom: float) -> float:
    """h with P(|shift + s T| <= h) = 0.95, where s^2 = std^2 - shift^2 and T has Student's t distribution.

    A shift is one fixed number, so an interval of 1.96 times all of std would hold more often than stated.
    """
    if shift == 0.0 or not np.isfinite(std):
        return _factor95(freedom) * std
    spread, off = float(np.sqrt(max(std * std - shift * shift, 0.0))), abs(shift)
    if spread <= _NEGLIGIBLE * off:
        return std
    # The freedom is that of all of the variance; the shift's part has no error of its own (Satterthwaite 1946).
    own = max(freedom * (spread / std) ** 4, 1.0)
    low, high = off, off + _factor95(own) * spread
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        inside = _student(own, (middle - off) / spread) - _student(own, -(middle + off) / spread)
        low, high = (middle, high) if inside < 0.95 else (low, middle)
    return high


def uncertainty(problem: FitProblem, p: Floats) -> Uncertainty:
    """Covariance of the free parameters at p (D,): (J^T J / sigma^2 + P)^-1, P the inverse variances of the priors.

    sigma^2 comes from the marks' residuals alone, over their degrees of freedom: two for each pair, less what the
    parameters take of them (the trace of the marks' part of the hat matrix; a prior takes its share of a parameter
    upon itself). Rows are whitened where the pairs state covariances; sigma then scales those. Holds for independent
    errors, of one size or of the sizes stated; `error_model` has what pairs share.
    """
    problem = whitened(problem, p)
    residuals, J = weighted_residuals(problem, p, turns_are_free(problem))
    of_marks = residuals[: 2 * len(problem.points)]
    freedom = 2 * int(np.count_nonzero(problem.weights)) - _taken(J, len(of_marks))
    # The trace is a sum of rounded numbers: less than one degree is none.
    if freedom < 0.999:
        return _spread(problem, J, problem.noise_scale * problem.mark_sigma_px, None)
    return _spread(problem, J, float(np.sqrt(of_marks @ of_marks / freedom)), freedom)


def _taken(J: Floats, of_marks: int) -> float:
    # Degrees of freedom that the parameters take of the first rows: the trace of those rows of the hat matrix.
    lengths = np.linalg.norm(J, axis=0)
    U, s, _ = np.linalg.svd(J / np.where(lengths > 0.0, lengths, 1.0), full_matrices=False)
    determined = s > _RANK_TOLERANCE * s[0] if s.size else s > 0.0
    return float(np.sum(U[:of_marks, determined] ** 2))


def turns_are_free(problem: FitProblem) -> bool:
    """Whether the rotations' deviations are of turns about the camera's axes, not of the search's parameters."""
    return not any(name in problem.priors or name in problem.locked for name in problem.names[:3]) and bool(
        np.all(np.isin((0, 1, 2), problem.free))
    )


def _spread(problem: FitProblem, rows: Floats, sigma: float, freedom: float | None) -> Uncertainty:
    # A prior's rows were made under the noise that the problem states; sigma is the noise as estimated by now.
    of_marks = 2 * len(problem.points)
    J = np.concatenate([rows[:of_marks], rows[of_marks:] * (sigma / (problem.noise_scale * problem.mark_sigma_px))])
    local = turns_are_free(problem)
    indices: list[int] = problem.free.tolist()
    names = tuple(_ROTATION_AXES[i] if local and i < 3 else problem.names[i] for i in indices)
    unit = units_of(names)
    lengths = np.linalg.norm(J, axis=0)
    lengths[lengths == 0.0] = 1.0
    _, s, Vt = np.linalg.svd(J / lengths, full_matrices=False)
    determined = s > _RANK_TOLERANCE * s[0] if s.size else s > 0.0
    half = (Vt[determined] / s[determined, None]) / lengths * sigma
    covariance = (half.T @ half) * unit[:, None] * unit[None, :]
    std = np.sqrt(np.diag(covariance))
    # A parameter that takes part in an undetermined direction is not known at all.
    std[np.any(np.abs(Vt[~determined]) > 1e-3, axis=0)] = np.inf
    whole = bool(np.all(determined))
    return Uncertainty(
        names,
        tuple(unit_of(name) for name in names),
        std,
        covariance,
        int(np.count_nonzero(determined)),
        sigma,
        condition=(float(s[0] / s[-1]) if whole else np.inf) if s.size else 1.0,
        freedom=freedom,
        undetermined=tuple(_parts(names, direction) for direction in Vt[~determined]),
        noise_scale=None if problem.covariances is None else sigma / problem.mark_sigma_px,
    )


def units_of(names: Sequence[str]) -> Floats:
    """Return the factors (F,) from radians, metres and pixels to people's units."""
    return np.array([np.degrees(1.0) if name in ANGLES else 1.0 for name in names])


def unit_of(name: str) -> str:
    """The unit people read that parameter in: deg, m, px, or 1."""
    if name in ANGLES:
        return "deg"
    if name.startswith("t_"):
        return "m"
    return "px" if name in ("f_x", "f_y", "c_x", "c_y") else "1"


def _parts(names: tuple[str, ...], direction: Floats) -> dict[str, float]:
    # The shares of a direction in the parameters scaled to equal effect, the larger ones only.
    order = np.argsort(-np.abs(direction), kind="stable")
    return {names[i]: float(direction[i]) for i in order.tolist() if abs(direction[i]) > 0.1}
