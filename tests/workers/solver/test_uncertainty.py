from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from tests.workers.solver.rigs import finish_plain, simulated
from workers.solver.polish import polish
from workers.solver.schedule import run_schedule
from workers.solver.uncertainty import Uncertainty, uncertainty

SHORT = {"slots": 1, "population": 200, "generations": 15, "max_iterations": 2}


def test_intervals_hold_their_share():
    held = []
    for seed in range(40):
        problem, truth = simulated("pinhole", 500 + seed, pairs=30)
        spread = uncertainty(problem, fit := np.array(polish(problem, truth).parameters))
        held += (np.abs(fit - truth) <= spread.half_width95)[3:].tolist()
    assert 0.9 < np.mean(held) < 0.99


@pytest.mark.parametrize("shape", ["place", "line", "plane"])
def test_points_without_extent_are_never_a_confident_answer(shape):
    problem, _ = simulated("pinhole", 92, pairs=40, schedule=SHORT)
    points = problem.points.copy()
    centre = points.mean(axis=0)
    if shape == "place":
        points[:] = centre
    elif shape == "line":
        points = centre + np.linspace(-2, 2, 40)[:, None] * [0.6, 0.8, 0.0]
    else:
        points[:, 0] = centre[0]
    flat = replace(problem, points=points)
    solution = finish_plain(flat, run_schedule(flat)[0])
    assert solution["status"] == "not_determined"
    assert f"one {shape}" in solution["message"]
    assert None in solution["std"].values()
    assert solution["rank"] < 10
    assert solution["undetermined"]


def test_points_behind_the_camera_are_never_a_confident_answer():
    problem, _ = simulated("pinhole", 93, pairs=40, schedule=SHORT)
    away = replace(problem, points=-problem.points)
    solution = finish_plain(away, run_schedule(away)[0])
    assert solution["status"] == "not_determined"
    assert "behind the camera" in solution["message"]


@pytest.mark.parametrize(("shift", "own"), [(0.5, 5.0), (1.0, 12.0), (3.0, 40.0)])
def test_a_shift_and_a_deviation_known_from_few_pairs_make_one_interval(shift, own):
    """|shift + s T| with T of `own` freedoms. What is stated is std^2 = s^2 + shift^2, whose freedom is
    own (std / s)^4, as the shift's part is exact (Satterthwaite 1946).
    """
    spread = 0.8
    std = np.hypot(spread, shift)
    stated = Uncertainty(
        names=("t_x",), units=("m",), std=np.array([std]), covariance=np.array([[std**2]]), rank=1, sigma_px=1.0,
        freedoms=np.array([own * (std / spread) ** 4]), shift=np.array([shift]),
    )  # fmt: skip
    (half,) = stated.half_width95
    inside = stats.t.cdf((half - shift) / spread, own) - stats.t.cdf(-(half + shift) / spread, own)
    assert inside == pytest.approx(0.95, abs=1e-6)
