"""One slot of the genetic algorithm: the unit of work that is farmed."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from apexcal.documents.fit_requests import fit_request
from apexcal.geometry.rotations import FORWARD_LIDAR_TO_OPTICAL
from apexcal.geometry.se3 import SE3, to_document
from workers.geometry.models import MODELS
from workers.solver.correlation import Component, Linearised, shares_of
from workers.solver.fitness import fitness_of
from workers.solver.genetic import SearchOutcome, genetic_search
from workers.solver.polish import polish
from workers.solver.problem import FitProblem, fit_problem
from workers.solver.random_streams import stream_key
from workers.solver.residuals import residuals_and_jacobian


@dataclass(frozen=True)
class SlotOutcome:
    """Best of one slot: loss in pixels (double precision), parameters in the order of `problem.names`."""

    loss: float
    parameters: tuple[float, ...]
    evaluations: int


def run_slot(
    problem: FitProblem, lower: Sequence[float], upper: Sequence[float], iteration: int, slot: int
) -> SlotOutcome:
    """Run slot number `slot` of `iteration` inside [lower, upper] (vectors in the order of `problem.names`).

    A pure function of its arguments, to the bit on one kind of processor: the randomness is keyed by (seed, model,
    camera, fold, iteration, slot). Locked parameters keep their value. A schedule whose slots are to agree polishes
    the best. Releases the interpreter's lock. Raises what the problem's `stop` raises.
    """
    fitness = fitness_of(problem, np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64))
    outcome = SearchOutcome(np.zeros(0, dtype=np.float32), 0)
    if fitness.genes:
        outcome = genetic_search(fitness, problem.schedule, stream_key(problem, iteration, slot), problem.stop)
    problem.stop.check()
    p = fitness.parameters(outcome.best)
    if problem.schedule.agreeing and np.isfinite(fitness.loss_px(p)):
        p = np.array(polish(problem, p).parameters)
    return SlotOutcome(fitness.loss_px(p), tuple(p.tolist()), outcome.evaluations)


def warm_up() -> None:
    """Compile every kernel, or load it from the cache; called in a worker's parent before it forks."""
    nominal = to_document(SE3("camera", "lidar", FORWARD_LIDAR_TO_OPTICAL, np.zeros(3)))
    points = np.random.default_rng(0).uniform((5.0, -1.0, -1.0), (9.0, 1.0, 1.0), (32, 3))
    schedule = {"slots": 1, "population": 64, "generations": 2, "max_iterations": 1}
    for model in MODELS:
        request = fit_request(model, (640, 480), nominal, schedule=schedule)
        problem = fit_problem(request, points, points[:, 1:] * 100.0 + 200.0)
        run_slot(problem, problem.lower.tolist(), problem.upper.tolist(), 0, 0)
        residuals_and_jacobian(problem, 0.5 * (problem.lower + problem.upper))
    shapes, lasting = np.tile(np.eye(2), (32, 1, 1)), np.arange(32.0)
    fit = Linearised(points[:, 1:], shapes, np.eye(2), np.zeros(2))
    shares = shares_of(fit, [Component(shapes, np.zeros(32, np.int64), lasting, 1.0)], 1.0)
    shares.components[0].product(shapes)
