"""One rig, four ways to calibrate it: which of them reach the optimum, and is the optimum any good?"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from apexcal.geometry.rotations import rotation_from_vector, vector_from_rotation
from benchmarks.accuracy.measures import WITHIN
from benchmarks.accuracy.rigs import PLAIN, Rig
from workers.solver.baselines import baseline, linear_baseline
from workers.solver.polish import Fit, cost_of, distances, polish
from workers.solver.problem import FitProblem
from workers.solver.schedule import run_schedule
from workers.solver.slot import run_slot
from workers.solver.uncertainty import uncertainty

Floats = NDArray[np.float64]
RIGHT_PX, FIELD_SHARE = 3.0, 0.9
"""A calibration counts as right where nine tenths of the field lie within three sigmas of a mark from the truth. Not
all of it: no fit from noisy marks knows a lens beyond the outermost mark."""
KNOWN_DEG, KNOWN_M = 1.0, 0.1
"""Standard deviations up to which a result states that the pairs hold the mount."""


@dataclass(frozen=True, eq=False)
class Case:
    """A rig to calibrate, the same camera with noiseless vertices all over the field, and how it is requested."""

    rig: Rig
    check: Rig
    request: dict[str, Any] = field(default_factory=dict)


def by_search(problem: FitProblem) -> Fit | None:
    """The genetic algorithm with the default preset, and the polish."""
    return polish(problem, run_schedule(problem)[0].best_parameters)


def by_one_slot(problem: FitProblem) -> Fit | None:
    """One slot of it over the whole bounds, and the polish."""
    return polish(problem, run_slot(problem, problem.lower.tolist(), problem.upper.tolist(), 0, 0).parameters)


METHODS: dict[str, Callable[[FitProblem], Fit | None]] = {
    "ga": by_search,
    "one_slot": by_one_slot,
    "centre": baseline,  # least squares from the centre of the bounds
    "linear": linear_baseline,  # from the linear cameras that RANSAC finds
}


def compare(case: Case, seed: int) -> dict[str, Any]:
    """What each way reached, beside the optimum: what the polish reaches from the true parameters.

    `success`: the cost is at most 0.1 % above that optimum's. Where the loss is `saturating` the optimum is that of
    the robust loss, and both costs are taken at the robust scale of the optimum. `right`: FIELD_SHARE of the field
    lies within RIGHT_PX of the truth. `beaten`: some way found a cost more than 0.1 % below the optimum.
    `known`: the standard deviations at the optimum claim that the pairs hold the mount (none with wrong marks).
    """
    problem = case.rig.problem(seed=seed, **(PLAIN | case.request))
    check = case.check.problem(rotation_range_deg=180.0)
    best = polish(problem, case.rig.truth)
    ways: dict[str, dict[str, Any]] = {}
    for name, method in METHODS.items():
        began = time.process_time()
        fit = method(problem)
        ways[name] = {"seconds": time.process_time() - began, **_judged(problem, check, fit, best)}
    return {
        "model": case.rig.model,
        "ways": ways,
        "beaten": any(way["over"] < 2.0 - WITHIN for way in ways.values()),
        **_worth_of(problem, case.rig.truth, check, best),
    }


def _judged(problem: FitProblem, check: FitProblem, fit: Fit | None, best: Fit) -> dict[str, Any]:
    if fit is None:
        return {"success": False, "right": False, "over": float("inf")}
    over = cost_of(problem, fit.parameters, best.scale_px) / max(best.cost, 1e-300)
    return {"success": over <= WITHIN, "right": _field_error(check, fit.parameters) <= RIGHT_PX, "over": over}


def _worth_of(problem: FitProblem, truth: Floats, check: FitProblem, best: Fit) -> dict[str, Any]:
    # What the optimum itself is worth: nobody who minimises this loss can do better.
    p = np.array(best.parameters)
    turn = rotation_from_vector(p[:3]) @ rotation_from_vector(truth[:3]).T
    std = uncertainty(problem, p).std[:6]
    known = bool((std[:3] <= KNOWN_DEG).all() and (std[3:] <= KNOWN_M).all())
    error = _field_error(check, best.parameters)
    return {
        "right": error <= RIGHT_PX,
        "field_error_px": error,
        "turn_error_deg": float(np.degrees(np.linalg.norm(vector_from_rotation(turn)))),
        "place_error_m": float(np.linalg.norm(_place(p) - _place(truth))),
        "known": known if problem.loss == "mean" else None,
    }


def _field_error(check: FitProblem, parameters: Sequence[float]) -> float:
    return float(np.quantile(distances(check, parameters), FIELD_SHARE))


def _place(p: Floats) -> Floats:
    # Where the camera stands, in the LiDAR's frame turned as the nominal camera: -R^T t.
    return -rotation_from_vector(p[:3]).T @ p[3:6]
