import json
from dataclasses import replace

import numpy as np
import pytest

from apexcal.geometry.se3 import from_document
from tests.faults.jobs import SHORT
from tests.workers.solver.rigs import (
    PLAIN,
    best_mean_px,
    finish_plain,
    real_problem,
    simulated,
)
from workers.geometry.models import DEFAULT_MODELS, INTRINSICS, SEARCH_FORMS
from workers.solver.narrowing import run_search, start
from workers.solver.outcomes import SolveError
from workers.solver.polish import polish
from workers.solver.solution import evaluate


def solve(problem):
    state = run_search(problem)
    solution = finish_plain(problem, state)
    return json.loads(json.dumps(solution, allow_nan=False))


@pytest.mark.parametrize("model", DEFAULT_MODELS)
def test_search_and_polish_reach_the_optimum_from_the_truth(model):
    for seed in range(3):
        problem, truth = simulated(model, seed + 40)
        solution = solve(problem)
        assert solution["status"] == "ok"
        assert solution["ga"]["mean_px"] < 1.01 * best_mean_px(problem, truth)
        weak = {name: (0.0, sigma) for name, sigma in solution["weak_priors"].items()}
        held = replace(problem, priors=weak, noise_scale=solution["sigma_px"])
        assert solution["polished"]["rms_px"] < 1.0001 * polish(held, truth).rms_px
        assert solution["at_bounds"] == [] and solution["several_optima"] == []


@pytest.mark.parametrize(("model", "limit_px"), [("pinhole", 19.5), ("brown_conrady", 4.3), ("kannala_brandt", 4.3)])
def test_the_real_board_is_fitted(model, limit_px):
    solution = solve(real_problem(model))
    assert solution["pairs"] == 80
    assert solution["polished"]["mean_px"] <= limit_px
    assert solution["at_bounds"] == []
    if model == "kannala_brandt":
        # The publisher's own calibration of this camera.
        assert solution["intrinsics"]["f_x"] == pytest.approx(1176.93, rel=0.05)
        assert solution["intrinsics"]["c_x"] == pytest.approx(962.275, abs=60)


def test_pairs_left_out_say_nothing_against_the_search():
    """The search saw all pairs, the polish the good ones: both are judged by the good ones."""
    problem, truth = simulated("pinhole", 47, outliers="exclude")
    marks = problem.pixels.copy()
    marks[:10] += (150.0, -90.0)
    spoiled = replace(problem, pixels=marks)

    def said(parameters):
        searched = {"best_parameters": tuple(parameters), "best_loss": 8.0, "history": (8.0,)}
        return finish_plain(spoiled, replace(start(spoiled), iteration=1, **searched))

    near = said(truth)
    assert {one["index"] for one in near["outliers"] if one["excluded"]} >= set(range(10))
    assert near["ga"]["rms_px"] > 4.0 * near["kept"]["rms_px"], "over all pairs"


@pytest.mark.parametrize("search", SEARCH_FORMS)
def test_documents_describe_the_same_solution(search):
    problem, _ = simulated("brown_conrady", 50, search=search, schedule=SHORT, **PLAIN)
    solution = solve(problem)
    assert solution["search"] == search and set(solution["ga"]["parameters"]) == set(problem.names)
    again = evaluate(solution["intrinsics"], solution["transform"], problem.points, problem.pixels)
    np.testing.assert_allclose(again["errors_px"], solution["residuals_px"], atol=1e-6)
    assert again["mean_px"] == pytest.approx(solution["polished"]["mean_px"])
    assert again["rms_px"] == pytest.approx(solution["polished"]["rms_px"])
    transform = from_document(solution["transform"])
    assert (transform.to_frame, transform.from_frame) == ("camera_front_optical", "velodyne")
    assert solution["parameters"]["t_x_m"] == transform.t[0]
    assert solution["parameters"]["k1"] == solution["intrinsics"]["k1"]
    assert set(solution["versions"]) >= {"numpy", "numba", "scipy"}


def test_locked_intrinsics_pin_the_rotation():
    free_problem, truth = simulated("pinhole", 51, schedule=SHORT)
    locks = dict(zip(INTRINSICS["pinhole"], truth[6:].tolist(), strict=True))
    locked_problem, _ = simulated("pinhole", 51, locked=locks, schedule=SHORT)
    free, locked = solve(free_problem), solve(locked_problem)
    assert locked["std"]["rotation_x"] < 0.05
    assert locked["std"]["rotation_x"] < 0.3 * free["std"]["rotation_x"]
    assert set(locked["std"]) == {"rotation_x", "rotation_y", "rotation_z", "t_x", "t_y", "t_z"}
    assert {name: locked["intrinsics"][name] for name in locks} == locks


def test_what_the_solution_forbids_counts_with_its_cost():
    problem, _ = simulated("pinhole", 53, schedule=SHORT)
    solution = solve(problem)
    behind = problem.points[:1] * [-1, 1, 1]
    score = evaluate(solution["intrinsics"], solution["transform"], behind, problem.pixels[:1])
    assert score["forbidden"] == 1
    assert score["max_px"] >= 1600


def test_a_run_stopped_from_outside_says_so():
    problem, _ = simulated("pinhole", 54, schedule={"slots": 4})
    problem = replace(problem, schedule=replace(problem.schedule, agreeing=0))
    with pytest.raises(SolveError):
        finish_plain(problem, start(problem))
    states = []
    run_search(problem, on_iteration=states.append)
    assert finish_plain(problem, states[0])["status"] == "unfinished"
