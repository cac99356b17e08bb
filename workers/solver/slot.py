"""One slot of the genetic algorithm: the unit of work that is farmed."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.schedules import Schedule
from workers.geometry.models import FORM_ID, MODEL_ID, MODELS
from workers.geometry.projection import distances_px
from workers.geometry.rotations import FORWARD_LIDAR_TO_OPTICAL
from workers.geometry.transforms import RigidTransform
from workers.solver.bounds import preset_bounds
from workers.solver.genetic import PARENT_SHARE, SPREAD, evolve
from workers.solver.problem import FitProblem
from workers.solver.random_streams import stream_key
from workers.solver.residuals import predict, residuals_and_jacobian, turned_points
from workers.solver.stopping import flag_of
from workers.solver.weighting import search_weights

LANES = 32
"""The pairs are padded to full vectors: 32 covers two of the widest that are about."""


@dataclass(frozen=True)
class SlotOutcome:
    """Best of one slot: loss in pixels (double precision), parameters in the order of `problem.names`."""

    loss: float
    parameters: tuple[float, ...]
    evaluations: int

    def to_document(self) -> dict[str, Any]:
        """JSON form; floats survive it exactly."""
        return {"loss": self.loss, "parameters": list(self.parameters), "evaluations": self.evaluations}

    @staticmethod
    def from_document(document: dict[str, Any]) -> "SlotOutcome":
        """The outcome of its JSON form."""
        parameters = tuple(float(value) for value in document["parameters"])
        return SlotOutcome(float(document["loss"]), parameters, int(document["evaluations"]))


def run_slot(
    problem: FitProblem, lower: Sequence[float], upper: Sequence[float], iteration: int, slot: int
) -> SlotOutcome:
    """Run slot number `slot` of `iteration` inside [lower, upper] (vectors in the order of `problem.names`).

    A pure function of its arguments, to the bit on one kind of processor: the randomness is keyed by (seed, model,
    camera, fold, iteration, slot). Locked parameters keep their value. Releases the interpreter's lock. Raises what
    the problem's `stop` raises.
    """
    low, high = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
    free = problem.free
    base = problem.lower.copy()
    width = (high - low)[free]
    fractions = np.zeros(len(free), dtype=np.float32)
    evaluations = 0
    if len(free):
        evaluations = evolve(
            MODEL_ID[problem.model],
            FORM_ID[problem.search],
            pack_pairs(problem),
            scales_of(problem),
            base,
            free,
            low[free],
            width,
            prior_rows(problem),
            problem.schedule.population,
            problem.schedule.generations,
            PARENT_SHARE,
            SPREAD,
            stream_key(problem, iteration, slot),
            fractions,
            flag_of(problem.stop),
        )
    problem.stop.check()
    base[free] = np.clip(low[free] + width * fractions.astype(np.float64), low[free], high[free])
    return SlotOutcome(loss_px(problem, base), tuple(base.tolist()), int(evaluations))


def loss_px(problem: FitProblem, parameters: Sequence[float] | NDArray[np.float64]) -> float:
    """The loss that the genetic algorithm minimises, in pixels, double precision, priors included."""
    p = np.asarray(parameters, dtype=np.float64)
    pixels, violation = predict(problem, p)
    d = distances_px(pixels, violation, problem.pixels, problem.diagonal_px)
    if problem.loss == "saturating":
        d = d / (1.0 + d / problem.saturation_px)
    prior = prior_rows(problem)
    off = (p - prior[0]) * prior[1]
    # Sums in index order whatever the BLAS, so that the bits are the same everywhere.
    weights, scales = search_weights(problem)[0], scales_of(problem)
    return float(np.sum(weights * d) * scales[2] + scales[3] * np.sum(off * off))


def pack_pairs(problem: FitProblem) -> NDArray[np.float32]:
    """The pairs as float32 (6, M): x y z u v weight, turned by the nominal rotation, padded with weight 0."""
    n = len(problem.points)
    pack = np.empty((6, (n + LANES - 1) // LANES * LANES), dtype=np.float32)
    pack[:3, :n] = turned_points(problem).T
    pack[3:5, :n] = problem.pixels.T
    pack[5, :n] = search_weights(problem)[0]
    pack[:5, n:] = pack[:5, n - 1 : n]
    pack[5, n:] = 0.0
    return pack


def scales_of(problem: FitProblem) -> NDArray[np.float64]:
    """(4,): image diagonal px, 1 / saturation (0: mean distance), 1 / sum of weights, the priors' share."""
    bend = 1.0 / problem.saturation_px if problem.loss == "saturating" else 0.0
    weights, sigma_px = search_weights(problem)
    total = float(np.sum(weights))
    # The mean distance is a Laplacian's log-likelihood per pair; a Gaussian prior adds z^2 / 2 in the same units,
    # for marks whose mean distance is sqrt(pi / 2) sigma_px.
    prior = 0.5 * sqrt(np.pi / 2.0) * sigma_px / total if problem.priors else 0.0
    return np.array([problem.diagonal_px, bend, 1.0 / total, prior])


def prior_rows(problem: FitProblem) -> NDArray[np.float64]:
    """(2, D): mean and 1 / sigma of each parameter's prior, 0 where there is none or it is locked."""
    rows = np.zeros((2, len(problem.names)))
    for index, name in enumerate(problem.names):
        if name in problem.priors and name not in problem.locked:
            mean, sigma = problem.priors[name]
            rows[:, index] = mean, 1.0 / sigma
    return rows


def warm_up() -> None:
    """Compile every kernel, or load it from the cache; called in a worker's parent before it forks."""
    nominal = RigidTransform("camera", "lidar", FORWARD_LIDAR_TO_OPTICAL, np.zeros(3))
    points = np.random.default_rng(0).uniform((5.0, -1.0, -1.0), (9.0, 1.0, 1.0), (32, 3))
    schedule = Schedule(slots=1, population=64, generations=2, max_iterations=1)
    for model in MODELS:
        bounds = preset_bounds("image-size", model, "rotation_vector", (640, 480), nominal)
        problem = FitProblem(
            model, "rotation_vector", nominal, (640, 480), points, points[:, 1:] * 100.0 + 200.0, np.ones(32),
            bounds, schedule=schedule,
        )  # fmt: skip
        run_slot(problem, problem.lower.tolist(), problem.upper.tolist(), 0, 0)
        residuals_and_jacobian(problem, 0.5 * (problem.lower + problem.upper))
