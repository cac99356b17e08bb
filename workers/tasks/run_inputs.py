"""A run as the solver sees it: its document and the pairs of its set, as the problem that is fitted."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.fit_requests import FitRequest
from apexcal.documents.pairs import CLOCK_SIGMA, CORNER, VELOCITY, held_together
from apexcal.geometry.motion import velocities_of
from service.platform.db.base import Json
from workers.solver.blocks import blocks_of
from workers.solver.common_errors import shares_of
from workers.solver.covariances import COLUMNS as COVARIANCE_COLUMNS
from workers.solver.covariances import covariances_of
from workers.solver.held_out import Fold, folds
from workers.solver.outcomes import NEVER, Stop
from workers.solver.problem import FitProblem, fit_problem
from workers.solver.rolling_shutter import at_their_rows


@dataclass(frozen=True, eq=False)
class RunInput:
    """A run as the solver sees it: the problem of the pairs it fits, and that of all pairs with those held out."""

    document: Json
    problem: FitProblem
    pairs: Json
    whole: FitProblem
    heldout: Fold | None


def read_run(document: Json, fold: int, pairs: Json, stop: Stop = NEVER) -> RunInput:
    """Return a run's problem: the pairs of its set, without those that its fold (-1: none) holds out.

    ``document``: the run's ``problem``. ``pairs``: its set's columns of equal length, in metres and pixels.
    """
    request = FitRequest.model_validate(document)
    whole = replace(_problem(request, pairs, None), stop=stop)
    if fold < 0:
        return RunInput(document, whole, pairs, whole, None)
    heldout = folds(held_together(pairs), request.folds)[fold]
    fitted = np.setdiff1d(np.arange(len(whole.points)), heldout.indices)
    return RunInput(document, replace(_problem(request, pairs, fitted), stop=stop), pairs, whole, heldout)


def _problem(request: FitRequest, pairs: Json, chosen: NDArray[np.int64] | None) -> FitProblem:
    """The problem of some pairs of a set, or of all."""
    columns = {
        name: np.asarray(pairs[name]) for name in ("x", "y", "z", "u", "v", *COVARIANCE_COLUMNS) if name in pairs
    }
    if chosen is not None:
        columns = {name: values[chosen] for name, values in columns.items()}
    points = np.column_stack([columns["x"], columns["y"], columns["z"]]).astype(np.float64)
    pixels = np.column_stack([columns["u"], columns["v"]]).astype(np.float64)
    covariances = None
    if request.weights == "covariances":
        covariance_columns = {name: columns[name] for name in COVARIANCE_COLUMNS if name in columns}
        covariances = covariances_of(covariance_columns, points, request.mark_sigma_px)
    velocities = _velocities(pairs)
    if velocities is None and CLOCK_SIGMA in pairs:
        # Boards that stand still are where they are, whatever the clocks say.
        stated = {name: value for name, value in request.common_errors.items() if name != "clock_ms"}
        request = request.model_copy(update={"common_errors": stated})
    problem = fit_problem(request, points, pixels, covariances=covariances)
    blocks, people = blocks_of(pairs), shares_of(pairs)
    if chosen is not None:
        blocks = blocks and blocks.taken(chosen)
        velocities = None if velocities is None else velocities[chosen]
        people = None if people is None else people[chosen]
    return at_their_rows(replace(problem, blocks=blocks, velocities=velocities, people=people))


def _velocities(pairs: Json) -> NDArray[np.float64] | None:
    if VELOCITY in pairs:
        return np.asarray(pairs[VELOCITY], np.float64)
    if "stamp_ns" not in pairs:
        return None
    points = np.column_stack([pairs["x"], pairs["y"], pairs["z"]])
    return velocities_of(points, pairs["stamp_ns"], pairs.get(CORNER))
