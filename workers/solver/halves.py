# pyright: reportMissingTypeStubs=false
"""Fits of two disjoint halves of the pairs: do they differ by no more than the full fit states?"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import special

from apexcal.documents.results import Halves
from workers.geometry.rotations import vector_from_rotation
from workers.solver.error_model import ErrorModel, weighed
from workers.solver.estimate import Estimate
from workers.solver.polish import polish
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
_FALSE_ALARMS: Final = 0.005
"""Chance that sound pairs raise an alarm, for each of five tests: two splits, by parameters and pixels; the turn."""
_MANY: Final = 1e6
_SPLITS: Final[tuple[Split, Split]] = ("alternating", "first_and_last")


def halves_of(found: Estimate) -> list[Halves]:
    """Both splits of the pairs that determine the estimate, if each half has enough pairs for the parameters.

    The halves are polished from the full result, with its bounds, locks and priors; priors count in both.
    """
    problem, errors = found.holding, found.errors
    if errors is None or problem.blocks is None:
        return []
    used = problem.weights > 0.0
    compared: list[Halves] = []
    for split, mask in zip(_SPLITS, problem.blocks.halves, strict=True):
        first, second = used & mask, used & ~mask
        if min(np.count_nonzero(first), np.count_nonzero(second)) > len(problem.free):
            compared.append(_compared(found, errors, split, first, second))
    return compared


def too_small(halves: list[Halves], problem: FitProblem) -> list[str]:
    """A sentence for each split whose halves differ by more than is stated."""
    blocks = "groups" if problem.blocks is not None and problem.blocks.kind == "group" else "stretches of the walk"
    return [_sentence(one, blocks) for one in halves if not one.holds]


def _sentence(one: Halves, blocks: str) -> str:
    if one.turned_ratio is not None and one.turned_limit is not None and one.turned_ratio > one.turned_limit:
        return (
            f"Between the first and the last half of the {blocks} the camera turned by {one.turned_deg:.2g} "
            f"degrees, {one.turned_ratio:.1f} times what noise explains: the standard deviations are too small. "
            "Check whether the mount moved or the clocks drifted, and calibrate from one half alone."
        )
    which = "every second" if one.split == "alternating" else "the first half"
    return (
        f"Fits of {which} of the {blocks} and of the others differ by {one.rotation_deg:.2f} degrees, "
        f"{one.translation_mm:.0f} mm and {one.field_px:.1f} px over the marks, {one.ratio:.1f} times what is "
        f"stated over the parameters and {one.field_ratio:.1f} times over the marks: the standard deviations "
        "are too small. Check the lens model, the clocks and the marks, and whether the mount moved."
    )


def _compared(found: Estimate, errors: ErrorModel, split: Split, first: Used, second: Used) -> Halves:
    problem, p = found.holding, found.held_at
    one, two = (_fitted(problem, p, half) for half in (first, second))
    mounts = [transform_of(problem, q) for q in (one, two)]
    apart: Floats = (predict(problem, one)[0] - predict(problem, two)[0])[first | second]
    # Linear steps from the full fit: parameters that the pairs hardly determine, like higher distortion terms, bend
    # the ends of the polished fits.
    step = errors.step(first) - errors.step(second)
    covariance = errors.difference(first, second)
    ratio, told = _root_mahalanobis(step / errors.scale, covariance / errors.scale[:, None] / errors.scale)
    J = residuals_and_jacobian(problem, p, turns_are_free(problem), walls=False)[1][:, problem.free]
    rows: Floats = J.reshape(len(first), 2, -1)[first | second].reshape(-1, len(step))
    stated: Floats = np.sum((rows @ covariance) * rows, axis=1)
    # The mean of moved^2 / stated is a sum of chi-squares; like one it has these degrees of freedom (Box 1954).
    shares = covariance @ (rows.T @ (rows / stated[:, None])) / len(rows)
    directions = 1.0 / float(np.sum(shares * shares.T))
    turned = _turned(found, errors, first) if split == "first_and_last" else None
    freedom = found.freedom
    tests = [(ratio, _limit(told, freedom))]
    tests.append((float(np.sqrt(np.mean((rows @ step) ** 2 / stated))), _limit(directions, freedom)))
    if turned is not None:
        tests.append(turned[1:])
    return Halves(
        split=split,
        pairs=[int(np.count_nonzero(first)), int(np.count_nonzero(second))],
        ratio=ratio,
        limit=tests[0][1],
        rotation_deg=float(np.degrees(np.linalg.norm(vector_from_rotation(mounts[0].R @ mounts[1].R.T)))),
        translation_mm=1e3 * float(np.linalg.norm(mounts[0].t - mounts[1].t)),
        field_px=float(np.linalg.norm(apart) / np.sqrt(len(apart))),
        stated_px=float(np.sqrt(2.0 * np.mean(stated))),
        field_ratio=tests[1][0],
        field_limit=tests[1][1],
        turned_deg=turned and turned[0],
        turned_ratio=turned and turned[1],
        turned_limit=turned and turned[2],
        holds=all(found <= limit for found, limit in tests),
    )


def _fitted(problem: FitProblem, p: Floats, half: Used) -> Floats:
    return np.array(polish(replace(problem, weights=problem.weights * half), p).parameters)


def _turned(found: Estimate, errors: ErrorModel, first: Used) -> tuple[float, float, float]:
    """The turn of the mount between the halves, all else being equal, in degrees and over its stated deviation, and
    the latter's limit.

    What stretches of a walk share is estimated beside the turn, because they would absorb it otherwise.
    """
    problem, p = whitened(found.holding, found.held_at), found.held_at
    turns = residuals_and_jacobian(problem, p, local=True)[1].reshape(len(first), 2, -1)[:, :, :3]
    columns = weighed(problem, np.where(first, 0.5, -0.5)[:, None, None] * turns)
    if found.plain is None or (problem.blocks is not None and problem.blocks.kind == "group"):
        wider = errors.with_columns(columns)
    else:
        wider = found.plain.with_columns(columns)
        shared = shared_errors(problem, p, wider)
        wider = shared[1] if shared is not None and shared[0].counted else wider
    step, covariance = wider.step()[-3:], wider.covariance()[-3:, -3:]
    freedom = float(np.median(wider.of_pairs().freedoms()[-3:]))
    turn = float(np.degrees(np.linalg.norm(step)))
    return turn, _root_mahalanobis(step, covariance)[0], _limit(3.0, freedom)


def _root_mahalanobis(step: Floats, covariance: Floats) -> tuple[float, float]:
    """Root mean square of a step in standard deviations, over the directions that have one, and their number."""
    values, vectors = np.linalg.eigh(covariance)
    told = values > 1e-12 * values[-1]
    along = vectors[:, told].T @ step
    return float(np.sqrt(np.mean(along**2 / values[told]))), float(np.count_nonzero(told))


def _limit(directions: float, freedom: float) -> float:
    # Fisher's F, because the stated deviation was itself estimated, with so many degrees of freedom.
    return float(np.sqrt(_f_quantile(directions, min(max(freedom, 1.0), _MANY), 1.0 - _FALSE_ALARMS)))
