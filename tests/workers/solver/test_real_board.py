"""The 80 recorded correspondences: how well each model fits, and what too few of them are told to hold."""

import numpy as np

from apexcal.documents.fit_requests import fit_request
from tests.workers.solver.rigs import NOMINAL, finish_plain, real_correspondences
from workers.solver.held_out import folds
from workers.solver.problem import fit_problem
from workers.solver.schedule import run_schedule
from workers.solver.solution import evaluate

SHORT = {"slots": 1, "population": 300, "generations": 25, "max_iterations": 6}
REQUEST = {"model": "brown_conrady", "image_size": [1920, 1208], "nominal": NOMINAL, "schedule": SHORT}


def solve(problem):
    return finish_plain(problem, run_schedule(problem)[0])


def test_the_top_vertices_alone_hold_too_little_and_held_out_poses_show_it():
    points, pixels, poses = real_correspondences()
    top = points[:, 2] == np.repeat(points[:, 2].reshape(20, 4).max(axis=1), 4)
    assert top.sum() == 20
    solution = solve(fit_problem(fit_request(**REQUEST), points[top], pixels[top]))
    fitted = solution["polished"]["mean_px"]
    assert fitted < 3.0, "they are fitted well"
    others = evaluate(solution["intrinsics"], solution["transform"], points[~top], pixels[~top])
    assert others["mean_px"] > 4.0 * fitted, "and say little of the rest"
    errors = []
    for number, (held_out, _) in enumerate(folds(poses[top], 5)):
        kept = np.setdiff1d(np.arange(20), held_out)
        one = solve(fit_problem(fit_request(**(REQUEST | {"fold": number})), points[top][kept], pixels[top][kept]))
        score = evaluate(one["intrinsics"], one["transform"], points[top][held_out], pixels[top][held_out])
        errors += score["errors_px"]
    assert len(errors) == 20
    assert np.mean(errors) > 2.0 * fitted
