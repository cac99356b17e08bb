"""What no fit can come out of: refused, or diagnosed in words; never `ok`, never a traceback."""

import json
from dataclasses import replace

import numpy as np
import pytest

from apexcal.documents.fit_requests import fit_request
from tests.workers.solver.rigs import NOMINAL, SIZE, finish_plain, simulated
from workers.geometry.models import MODELS
from workers.solver.narrowing import run_search
from workers.solver.outcomes import SolveError
from workers.solver.problem import fit_problem
from workers.solver.residuals import predict

SHORT = {"slots": 1, "population": 64, "generations": 6, "max_iterations": 2}
PAIRS = 24


def placed(model, points, marks=None):
    """The problem of these points, seen by a true camera with 1 px noise where no marks are given."""
    problem, truth = simulated(model, 92, pairs=PAIRS, schedule=SHORT)
    moved = replace(problem, points=points(problem.points) if callable(points) else points)
    if marks is None:
        exact = predict(moved, truth)[0]
        marks = exact + np.random.default_rng(1).normal(size=exact.shape)
    return replace(moved, pixels=marks(problem.pixels) if callable(marks) else marks)


def first(values):
    return np.tile(values[:1], (len(values), 1))


def in_a_plane(points, thickness_m=0.0):
    flat = points.copy()
    flat[:, 0] = points[:, 0].mean() + thickness_m * np.random.default_rng(0).normal(size=len(points))
    return flat


def four(values):
    return values[np.arange(len(values)) % 4]


CASES = {
    "one place, marks all over": (lambda x: np.tile(x.mean(axis=0), (len(x), 1)), np.copy, "one place"),
    "one pair many times": (first, first, "one place"),
    "one line": (lambda x: x.mean(axis=0) + np.linspace(-2, 2, len(x))[:, None] * [0.6, 0.8, 0.0], None, "one line"),
    "one plane": (in_a_plane, None, "one plane"),
    "one plane to a millimetre": (lambda x: in_a_plane(x, 1e-3), None, "one plane"),
    "nearly one plane": (lambda x: in_a_plane(x, 0.02), None, "do not determine"),
    "behind the camera": (np.negative, np.copy, "behind the camera"),
    "one frame's vertices again and again": (four, four, "different corners only"),
}


@pytest.mark.parametrize(
    ("case", "model"),
    [*((case, "pinhole") for case in CASES), *zip(list(CASES)[2:5], MODELS[1:], strict=True)],
)
def test_a_fit_that_can_be_anything_says_so(case, model):
    points, marks, words = CASES[case]
    problem = placed(model, points, marks)
    solution = json.loads(json.dumps(finish_plain(problem, run_search(problem)), allow_nan=False))
    assert solution["status"] == "not_determined"
    assert words in solution["message"]
    if words in ("one place", "one line") or (case, model) == ("one plane", "pinhole"):
        assert solution["rank"] < solution["free_parameters"] and solution["undetermined"]
    # Nowhere a confident number: what is not known at all, or to metres and tens of degrees, is shown as that.
    std = solution["std"]
    assert any(value is None for value in std.values()) or any(
        std[name] > limit for name, limit in (("t_z", 1.0), ("t_x", 1.0), ("f_x", 0.2 * SIZE[0]))
    )


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("what", ["points", "pixels", "weights"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_number_that_is_none_is_refused_by_its_pair(model, what, value):
    rng = np.random.default_rng(0)
    given = {"points": rng.uniform(2, 9, (40, 3)), "pixels": rng.uniform(0, 900, (40, 2)), "weights": np.ones(40)}
    given[what][17] = value
    with pytest.raises(SolveError, match="pair 17") as caught:
        fit_problem(fit_request(model=model, image_size=SIZE, nominal=NOMINAL), **given)
    assert caught.value.code == "non_finite"


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("pairs", [0, 1, 4, 9])
def test_fewer_pairs_than_free_parameters_are_refused(model, pairs):
    rng = np.random.default_rng(0)
    document = {"model": model, "image_size": SIZE, "nominal": NOMINAL}
    with pytest.raises(SolveError) as caught:
        fit_problem(fit_request(**document), rng.uniform(2, 9, (pairs, 3)), rng.uniform(0, 900, (pairs, 2)))
    assert caught.value.code == "too_few_pairs"
    assert f"{pairs} pairs" in caught.value.message
    assert "smaller model" in caught.value.hint


def test_marks_upside_down_under_a_known_lens_are_not_explained():
    """Every parameter is held, none at its bound, and the mount found is wrong."""
    problem, truth = simulated("pinhole", 7, pairs=60, schedule=SHORT)
    upside_down = problem.pixels * [1.0, -1.0] + [0.0, SIZE[1] - 1.0]
    known = dict(zip(problem.names[3:], truth[3:].tolist(), strict=True))
    for marks, status in ((upside_down, "not_explained"), (problem.pixels, "ok")):
        one = replace(problem, pixels=marks, locked=known)
        solution = finish_plain(one, run_search(one))
        assert solution["status"] == status
        assert ("Half of the pairs lie more than" in solution["message"]) == (status != "ok")
