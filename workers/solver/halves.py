# pyright: reportMissingTypeStubs=false
"""Fits of two disjoint halves of the pairs: do they differ by no more than the full fit states?"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from apexcal.documents.checks import figure
from apexcal.documents.precision import Halves
from apexcal.geometry.rotations import vector_from_rotation
from workers.solver.error_model import ErrorModel, weighed
from workers.solver.estimate import Estimate
from workers.solver.polish import refine
from workers.solver.problem import FitProblem
from workers.solver.residuals import predict, residuals_and_jacobian, transform_of
from workers.solver.shared_errors import shared_errors
from workers.solver.uncertainty import turns_are_free
from workers.solver.weighting import whitened

Floats = NDArray[np.float64]
Used = NDArray[np.bool_]
Split = Literal["alternating", "first_and_last"]
# scipy publishes no types.
_f_quantile: Callable[[float, float, float], float] = special.fdtri
_FALSE_ALARMS: Final = 0.001
_TURNS_FALSE_ALARMS: Final = 0.001
"""Chances that sound pairs exceed a limit: in each of four tests (two splits, by parameters and by pixels), and in
the test for a turn. Together they are one in 200, as every check of a result has it."""
_MANY: Final = 1e6
_SPLITS: Final[tuple[Split, Split]] = ("alternating", "first_and_last")


def halves_of(whole: Estimate) -> list[Halves]:
    """Compare both splits of the determining pairs, if each half determines the parameters by itself.

    The halves are polished from the full result, with its bounds, locks and priors; priors count in both.
    """
    problem, errors = whole.holding, whole.errors
    if errors is None or problem.blocks is None:
        return []
    used = problem.weights > 0.0
    compared: list[Halves] = []
    for split, mask in zip(_SPLITS, problem.blocks.halves, strict=True):
        first, second = used & mask, used & ~mask
        enough = min(np.count_nonzero(first), np.count_nonzero(second)) > len(problem.free)
        if enough and errors.determines(first) and errors.determines(second):
            compared.append(_compared(whole, errors, split, first, second))
    return compared


def too_small(halves: list[Halves], problem: FitProblem) -> list[str]:
    """A sentence for each split whose halves differ by more than is stated."""
    blocks = "groups" if problem.blocks is not None and not problem.blocks.over_time else "stretches of the walk"
    return [_sentence(split, blocks) for split in halves if not split.holds]


def _sentence(split: Halves, blocks: str) -> str:
    turn, ratio, limit = split.turned_deg, split.turned_ratio, split.turned_limit
    if turn is not None and ratio is not None and limit is not None and ratio > limit:
        return (
            f"The camera turned by {figure(turn)} degrees between the first and the last half of the {blocks}, "
            f"{ratio:.1f} times what is stated (limit {limit:.1f}): the stated errors are too small."
        )
    which = "every second" if split.split == "alternating" else "the first half"
    return (
        f"The stated errors are too small: fits of {which} of the {blocks} and of the others differ by "
        f"{split.rotation_deg:.2f} degrees, {split.translation_mm:.0f} mm and {split.field_px:.1f} px over the "
        f"marks. That is {split.ratio:.1f} times what is stated (limit {split.limit:.1f}), over the marks "
        f"{split.field_ratio:.1f} times (limit {split.field_limit:.1f})."
    )


def _compared(whole: Estimate, errors: ErrorModel, split: Split, first: Used, second: Used) -> Halves:
    problem, p = whole.holding, whole.held_at
    first_fit, second_fit = (_fitted(problem, p, half) for half in (first, second))
    mounts = [transform_of(problem, q) for q in (first_fit, second_fit)]
    apart: Floats = (predict(problem, first_fit)[0] - predict(problem, second_fit)[0])[first | second]
    J = residuals_and_jacobian(problem, p, turns_are_free(problem), walls=False)[1][:, problem.free]
    rows: Floats = J.reshape(len(first), 2, -1)[first | second].reshape(-1, len(problem.free))
    ratios, stated = _ratios(errors, rows, first, second)
    # Stretches may share errors that are too small to count. What these explain raises no objection.
    wider = whole.wider or errors
    explained = ratios if wider is errors else _ratios(wider, rows, first, second)[0]
    limits = [
        ratio.ratio * _limit(other) / other.ratio if other.ratio > 0.0 else _limit(other)
        for ratio, other in zip(ratios, explained, strict=True)
    ]
    turned = _turned(whole, errors, first) if split == "first_and_last" else None
    turned_limit = turned and _limit(turned[1], _TURNS_FALSE_ALARMS)
    return Halves(
        split=split,
        pairs=[int(np.count_nonzero(first)), int(np.count_nonzero(second))],
        ratio=ratios[0].ratio,
        limit=limits[0],
        rotation_deg=float(np.degrees(np.linalg.norm(vector_from_rotation(mounts[0].R @ mounts[1].R.T)))),
        translation_mm=1e3 * float(np.linalg.norm(mounts[0].t - mounts[1].t)),
        field_px=float(np.linalg.norm(apart) / np.sqrt(len(apart))),
        stated_px=float(np.sqrt(2.0 * np.mean(stated))),
        field_ratio=ratios[1].ratio,
        field_limit=limits[1],
        turned_deg=turned and turned[0],
        turned_ratio=turned and turned[1].ratio,
        turned_limit=turned_limit,
        holds=all(ratio.ratio <= limit for ratio, limit in zip(ratios, limits, strict=True))
        and (turned is None or turned_limit is None or turned[1].ratio <= turned_limit),
    )


class _Ratio(NamedTuple):
    """The root mean square of a difference over its stated size; its number of directions; and the degrees of freedom
    of the stated size (Satterthwaite 1946).
    """

    ratio: float
    directions: float
    freedom: float


def _ratios(errors: ErrorModel, rows: Floats, first: Used, second: Used) -> tuple[list[_Ratio], Floats]:
    """The ratios of the halves' fits, over the parameters and over the marks; and the stated variances (M,) of the
    marks' differences, px^2. `rows` (M, F): the marks' derivatives.
    """
    # Linear steps from the full fit: parameters that the pairs hardly determine, like higher distortion terms, bend
    # the ends of the polished fits.
    step, covariance, parts = errors.difference(first, second)
    over_parameters = _root_mahalanobis(errors, step, covariance, parts)
    moved: Floats = rows @ _directions(covariance)[1]
    stated: Floats = np.sum(moved**2, axis=1)
    # The mean of difference^2 / stated is a sum of chi-squares. One chi-square with so many degrees of freedom stands
    # for it (Box 1954).
    weighed: Floats = rows / stated[:, None]
    shares = moved.T @ (moved / stated[:, None]) / len(rows)
    grows = np.array([np.sum((rows @ part) * weighed) / len(rows) for part in parts])
    over_marks = float(np.sqrt(np.mean((rows @ step) ** 2 / stated)))
    directions = 1.0 / float(np.sum(shares**2))
    return [over_parameters, _Ratio(over_marks, directions, errors.freedom_of(grows))], stated


def _fitted(problem: FitProblem, p: Floats, half: Used) -> Floats:
    return np.array(refine(replace(problem, weights=problem.weights * half), p).parameters)


def _turned(whole: Estimate, errors: ErrorModel, first: Used) -> tuple[float, _Ratio]:
    """The turn of the mount between the halves, all else being equal, in degrees and over its stated deviation.

    What stretches of a walk share is estimated beside the turn, because they would absorb it otherwise.
    """
    problem, p = whitened(whole.holding, whole.held_at), whole.held_at
    turns = residuals_and_jacobian(problem, p, local=True)[1].reshape(len(first), 2, -1)[:, :, :3]
    columns = weighed(problem, np.where(first, 0.5, -0.5)[:, None, None] * turns)
    if whole.plain is None or (problem.blocks is not None and not problem.blocks.over_time):
        wider = errors.with_columns(columns)
    else:
        wider = whole.plain.with_columns(columns)
        shared = shared_errors(problem, p, wider)
        wider = wider if shared is None else shared.wider
    step, covariance = wider.step()[-3:], wider.covariance()[-3:, -3:]
    parts = [part[-3:, -3:] for part in wider.parts()]
    return float(np.degrees(np.linalg.norm(step))), _root_mahalanobis(wider, step, covariance, parts)


def _root_mahalanobis(errors: ErrorModel, step: Floats, covariance: Floats, parts: Sequence[Floats]) -> _Ratio:
    """A step in standard deviations, over the directions that have one; `parts` as in `ErrorModel.parts`."""
    along, _ = _directions(covariance)
    count = float(along.shape[1])
    grows = np.array([np.sum((part @ along) * along) for part in parts]) / count
    return _Ratio(float(np.sqrt(np.mean((along.T @ step) ** 2))), count, errors.freedom_of(grows))


def _directions(covariance: Floats) -> tuple[Floats, Floats]:
    """The directions (F, D) of a covariance, each over its deviation and times it; without those lost in rounding.

    A board that stood in two places leaves directions whose computed variance is below zero.
    """
    unit = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    unit[unit == 0.0] = 1.0
    values, vectors = np.linalg.eigh(covariance / (unit[:, None] * unit))
    determined = values > 1e-12 * values[-1]
    vectors, deviations = vectors[:, determined], np.sqrt(values[determined])
    return vectors / (unit[:, None] * deviations), vectors * deviations * unit[:, None]


def _limit(ratio: _Ratio, false_alarms: float = _FALSE_ALARMS) -> float:
    # Fisher's F, because the stated deviation was itself estimated, with so many degrees of freedom.
    freedom = min(max(ratio.freedom, 1.0), _MANY)
    return float(np.sqrt(_f_quantile(ratio.directions, freedom, 1.0 - false_alarms)))
