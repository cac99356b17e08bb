from dataclasses import astuple

import numpy as np
import pytest

from apexcal.documents.errors import DocumentError
from apexcal.documents.fit_requests import fit_request
from tests.workers.solver.rigs import NOMINAL, SIZE, simulated
from workers.solver.problem import fit_problem

POINTS = np.random.default_rng(0).uniform((4, -2, -1), (20, 2, 1), (40, 3))
PIXELS = np.random.default_rng(1).uniform(0, 900, (40, 2))
REQUEST = {"model": "pinhole", "image_size": SIZE, "nominal": NOMINAL}


def refusal(document=None, points=POINTS, pixels=PIXELS, weights=None):
    with pytest.raises(DocumentError) as caught:
        fit_problem(fit_request(**(REQUEST | (document or {}))), points, pixels, weights)
    assert caught.value.message
    return caught.value


@pytest.mark.parametrize(
    ("document", "code"),
    [
        ({"search": "quaternion"}, "unknown_search_form"),
        ({"bounds": {"f_x": [300]}}, "bad_fit_request"),
        ({"bounds": {"f_x": [float("nan"), 300]}}, "bad_fit_request"),
        ({"bounds": {"k1": [0, 1]}}, "unknown_parameter"),
        ({"locked": {"alpha": 0.0}}, "unknown_parameter"),
        ({"locked": {"f_x": float("inf")}}, "bad_fit_request"),
        ({"priors": {"f_x": {"mean": 500, "sigma": 0}}}, "bad_fit_request"),
        ({"bounds_preset": "huge"}, "bad_fit_request"),
        ({"rotation_range_deg": -3}, "bad_fit_request"),
        ({"loss": "rms"}, "bad_fit_request"),
        ({"preset": "fast"}, "unknown_preset"),
        ({"schedule": {"slots": 0}}, "bad_schedule"),
        ({"schedule": {"slots": "many"}}, "bad_schedule"),
        ({"schedule": {"islands": 3}}, "bad_schedule"),
        ({"nominal": {"to_frame": "a"}}, "bad_fit_request"),
        ({"image_size": (0, 480)}, "bad_fit_request"),
        ({"common_errors": {"clock_ms": -1.0}}, "bad_fit_request"),
        ({"common_errors": {"moon": 1.0}}, "bad_fit_request"),
    ],
)
def test_requests_that_cannot_be_run_are_answered(document, code):
    assert refusal(document).code == code


def test_pairs_that_cannot_be_fitted_are_answered():
    assert refusal(points=POINTS[:5]).code == "bad_shape"
    assert refusal(weights=np.where(np.arange(40) < 9, 1.0, 0.0)).code == "too_few_pairs"
    assert refusal(weights=-np.ones(40)).code == "bad_shape"


def test_locks_lower_the_number_of_pairs_needed():
    locked = {"f_x": 700, "f_y": 700, "c_x": 640, "c_y": 480}
    problem = fit_problem(fit_request(**(REQUEST | {"locked": locked})), POINTS[:6], PIXELS[:6])
    assert len(problem.free) == 6
    assert problem.bounds["f_x"] == (700.0, 700.0)


def test_what_cannot_move_has_no_prior():
    fixed = {"locked": {"f_x": 700}, "bounds": {"f_y": [700, 700]}}
    priors = {name: {"mean": 900, "sigma": 1} for name in ("f_x", "f_y", "c_x")}
    problem = fit_problem(fit_request(**REQUEST, **fixed, priors=priors), POINTS, PIXELS)
    assert problem.priors == {"c_x": (900.0, 1.0)}, "a constant row would count as noise of the marks"


def test_image_size_bounds_follow_the_image_and_the_nominal():
    problem, _ = simulated("brown_conrady", 1)
    assert problem.bounds["f_x"] == (256.0, 3840.0)
    assert problem.bounds["c_y"] == (0.0, 959.0)
    assert problem.bounds["skew"] == (-0.1, 0.1)
    assert problem.bounds["t_x"] == (-1.0, 1.0)
    assert problem.bounds["rotation_y"] == pytest.approx((-np.pi / 6, np.pi / 6))


def test_presets_are_those_of_the_paper_and_of_the_toolbox():
    problem, _ = simulated("brown_conrady", 1, preset="paper")
    assert problem.search == "euler"
    assert problem.bounds["alpha"] == pytest.approx((0.2 * np.pi, 0.8 * np.pi))
    assert problem.bounds["f_x"] == (300.0, 900.0)
    assert astuple(problem.schedule)[:3] == (5, 800, 30)
    once, _ = simulated("pinhole", 1, preset="toolbox", schedule={"generations": 10})
    assert (*astuple(once.schedule)[:3], once.schedule.max_iterations) == (20, 2000, 10, 1)


def test_degrees_are_read_by_name():
    priors = {"rotation_z_deg": {"mean": 1, "sigma": 2}}
    turns = {"bounds": {"rotation_x_deg": [-10, 20]}, "locked": {"rotation_y_deg": 3}, "priors": priors}
    problem, _ = simulated("pinhole", 1, **turns)
    assert problem.bounds["rotation_x"] == pytest.approx(np.radians((-10, 20)))
    assert problem.locked["rotation_y"] == pytest.approx(np.radians(3))
    assert problem.priors["rotation_z"] == pytest.approx(np.radians((1, 2)))
