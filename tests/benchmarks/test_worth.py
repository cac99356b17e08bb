"""Where the genetic algorithm is worth having: the cases are what they say, and the comparison can go either way."""

import numpy as np
import pytest

from benchmarks.accuracy.rigs import PAIRS, draw_rig
from benchmarks.worth.methods import compare
from benchmarks.worth.mistakes import in_walking_order, other_corner, slipped_run, swapped_neighbours
from benchmarks.worth.questions import QUESTIONS, answer, case_of
from benchmarks.worth.walks import camera_points, random_turn, remounted
from workers.solver.polish import distances
from workers.solver.slot import warm_up


@pytest.fixture(scope="module", autouse=True)
def compiled():
    warm_up()


@pytest.fixture
def rng():
    return np.random.default_rng(11)


@pytest.fixture
def rig(rng):
    return draw_rig("pinhole", rng)


def test_another_mount_sees_the_same_picture(rig, rng):
    for limit in (5.0, 90.0, 180.0):
        other = remounted(rig, random_turn(limit, rng))
        assert np.degrees(np.linalg.norm(other.truth[:3])) <= limit
        error = distances(other.problem(rotation_range_deg=180.0), other.truth)
        assert error == pytest.approx(distances(rig.problem(), rig.truth), abs=1e-6)
        assert error.mean() == pytest.approx(np.sqrt(np.pi / 2.0), rel=0.2)


def test_marks_are_wrong_as_people_and_clocks_are(rig, rng):
    order = in_walking_order(rig)

    def moved(marks):
        return np.flatnonzero((marks[order] != rig.marks[order]).any(axis=1))

    assert len(moved(other_corner(rig, 0.3, rng))) == round(0.3 * PAIRS)
    swapped = swapped_neighbours(rig, 0.4, rng)
    pairs = moved(swapped)
    assert (pairs[1::2] - pairs[::2] == 1).all()
    assert np.array_equal(swapped[order][pairs[::2]], rig.marks[order][pairs[1::2]])
    slipped = slipped_run(rig, 0.2, rng)
    run = moved(slipped)
    assert len(run) == round(0.2 * PAIRS) and (np.diff(run) == 1).all()
    assert np.array_equal(slipped[order][run], rig.marks[order][run + 1])
    assert np.median(np.linalg.norm(np.diff(camera_points(rig)[order][:, [0, 2]], axis=0), axis=1)) < 3.0


def test_the_comparison_tells_who_fails():
    rng = np.random.default_rng(3)
    case = case_of(QUESTIONS["mount"], "pinhole", 180.0, rng)
    while np.linalg.norm(case.rig.truth[:3]) < np.radians(160.0):
        case = case_of(QUESTIONS["mount"], "pinhole", 180.0, rng)
    outcome = compare(case, 1)
    assert not outcome["ways"]["centre"]["success"]
    assert all(outcome["ways"][name]["success"] for name in ("ga", "one_slot", "linear"))
    assert outcome["right"] and outcome["known"]


def test_a_walk_at_one_height_gives_an_optimum_that_is_wrong():
    outcome = answer(("plane", 0, 0), 4)
    assert outcome["ways"]["ga"]["success"]
    assert not outcome["right"] and not outcome["known"]
