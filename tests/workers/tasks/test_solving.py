"""What a slot may write."""

from types import SimpleNamespace
from typing import Any
from uuid import uuid4

import numpy as np
import pytest

from apexcal.documents.fit_requests import fit_request
from apexcal.geometry.rotations import FORWARD_LIDAR_TO_OPTICAL
from apexcal.geometry.se3 import SE3, to_document
from workers.solver.outcomes import SolveError
from workers.solver.problem import fit_problem
from workers.solver.slot import SlotOutcome, run_slot
from workers.tasks.solving import _slot_row

WORKER: Any = SimpleNamespace(worker="host:1")


def slot_of(marks_px: float) -> SlotOutcome:
    """The best of a slot whose marks lie so far from the image's corner."""
    nominal = to_document(SE3("camera", "lidar", FORWARD_LIDAR_TO_OPTICAL, np.zeros(3)))
    points = np.random.default_rng(0).uniform((5.0, -1.0, -1.0), (9.0, 1.0, 1.0), (32, 3))
    schedule = {"slots": 1, "population": 64, "generations": 2, "max_iterations": 1}
    request = fit_request("pinhole", (640, 480), nominal, loss="mean", schedule=schedule)
    problem = fit_problem(request, points, np.full((32, 2), marks_px))
    with np.errstate(over="ignore", invalid="ignore"):
        return run_slot(problem, problem.lower.tolist(), problem.upper.tolist(), 0, 0)


def test_a_slot_that_finds_nothing_finite_says_so_before_anything_is_written() -> None:
    row = _slot_row(WORKER, uuid4(), 0, 3, slot_of(200.0), 0.1)
    assert (row["slot"], row["worker"]) == (3, "host:1") and np.isfinite(row["loss"])
    with pytest.raises(SolveError, match="slot 3 in iteration 0") as found:
        _slot_row(WORKER, uuid4(), 0, 3, slot_of(1.7e308), 0.1)
    assert found.value.code == "non_finite"
