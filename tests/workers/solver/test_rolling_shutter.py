"""Cameras that read their rows one after the other."""

import statistics
from dataclasses import replace

import numpy as np
import pytest

from tests.workers.solver.draws import few_or_many
from tests.workers.solver.walks import Recomputed, finish, walked
from workers.solver.outcomes import SolveError
from workers.solver.residuals import predict
from workers.solver.rolling_shutter import at_their_rows

LINE_TIME_US = 60.0


def rolled(seed, line_time_us=LINE_TIME_US):
    """(problem, truth): a walk whose marks lie where the apex was when their rows were read."""
    problem, truth = walked(seed)
    random = np.random.default_rng([seed, 6])
    side = np.where(random.uniform(size=len(problem.points)) < 0.5, -1.2, 1.2)
    problem = replace(problem, velocities=side[:, None] * [0.0, 1.0, 0.0])
    noise = problem.pixels - predict(problem, truth)[0]
    pixels = problem.pixels
    for _ in range(3):
        late = replace(problem, pixels=pixels, line_time_us=line_time_us)
        pixels = predict(at_their_rows(late), truth)[0] + noise
    return replace(problem, pixels=pixels), truth


def test_a_rolling_shutter_shows_and_is_gone_where_its_line_time_is_given():
    problem, truth = rolled(41)
    document = finish(problem, truth)
    shown = document["rolling_shutter"]
    assert shown["shown"] and abs(shown["line_time_us"] - LINE_TIME_US) < 3.0 * shown["std_us"]
    given = finish(at_their_rows(replace(problem, line_time_us=LINE_TIME_US)), truth)
    assert not given["rolling_shutter"]["shown"] and given["line_time_us"] == LINE_TIME_US
    assert given["polished"]["rms_px"] < document["polished"]["rms_px"]


def test_the_line_time_is_a_further_unknown_of_least_squares():
    problem, truth = rolled(43)
    document = finish(problem, truth)
    again = Recomputed(document, problem.points, problem.pixels)
    rows = problem.pixels[:, 1] - 0.5 * (problem.image_size[1] - 1)
    late = 1e-6 * rows[:, None] * problem.velocities

    def moved(x):
        return problem.points + (0.0 if x is None else x[0]) * 1e4 * late

    # A line time of 0.01 s a row, so that the difference is not lost in rounding.
    column = 1e-4 * again.derivative(lambda x: again.project(np.zeros(10), moved(x)), 1)
    A = np.concatenate([again.J, column], axis=1)
    A /= np.linalg.norm(A, axis=0)
    normal = np.linalg.inv(A.T @ A)
    step = -(normal @ A.T @ again.residuals)[-1] / np.linalg.norm(column)
    deviation = document["sigma_px"] * np.sqrt(normal[-1, -1]) / np.linalg.norm(column)
    shown = document["rolling_shutter"]
    if not document["shared_errors"]["counted"]:
        assert shown["std_us"] == pytest.approx(deviation, rel=1e-3)
    assert shown["line_time_us"] == pytest.approx(step, rel=1e-3)


@few_or_many(10, 20)
def test_cameras_without_it_are_hardly_ever_accused(draws):
    found = [finish(*rolled(700 + seed, 0.0))["rolling_shutter"] for seed in range(draws)]
    ratios = [one["line_time_us"] / one["std_us"] for one in found]
    assert sum(one["shown"] for one in found) <= 1
    assert 0.6 < np.std(ratios) < 1.5


def test_a_deviation_of_the_line_time_widens_and_both_need_motion():
    problem, truth = rolled(45, 0.0)
    wider = finish(replace(problem, common_errors={"line_time_us": 20.0}), truth)
    narrow = finish(problem, truth)
    # The noise is estimated beside the line time.
    assert all(wider["std"][name] >= 0.995 * narrow["std"][name] for name in wider["std"])
    assert wider["std"]["t_x"] ** 2 + wider["std"]["f_x"] ** 2 > narrow["std"]["t_x"] ** 2 + narrow["std"]["f_x"] ** 2
    still = replace(problem, velocities=None, line_time_us=10.0)
    with pytest.raises(SolveError, match="line_time_us"):
        at_their_rows(still)
    assert finish(replace(still, line_time_us=0.0), truth)["rolling_shutter"] is None


def test_the_limit_is_what_one_in_two_hundred_exceeds():
    """The normal's, or Student's with so few degrees of freedom as blocks of a walk leave."""
    shown = finish(*rolled(46, 0.0))["rolling_shutter"]
    assert statistics.NormalDist().inv_cdf(1.0 - 0.0025) <= shown["limit"] < 4.0  # 4.0: seven degrees of freedom
