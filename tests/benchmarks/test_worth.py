"""Where the genetic algorithm is worth having: the cases are what they say, and the comparison can go either way."""

import numpy as np
import pytest

from benchmarks.accuracy.rigs import PAIRS, draw_rig
from benchmarks.worth.methods import compare
from benchmarks.worth.mistakes import in_walking_order, other_corner, slipped_run, swapped_neighbours
from benchmarks.worth.questions import QUESTIONS, answer, case_of
from benchmarks.worth.summary import curve, wilson
from benchmarks.worth.walks import (
    all_round,
    camera_points,
    camera_with_view,
    flat_field,
    one_line,
    random_turn,
    remounted,
    walked,
)
from workers.geometry.models import MODELS
from workers.simulation.walker import BOARD_EDGES_M
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
        assert np.allclose(camera_points(other), camera_points(rig))
        error = distances(other.problem(rotation_range_deg=180.0), other.truth)
        assert error == pytest.approx(distances(rig.problem(), rig.truth), abs=1e-6)
        assert error.mean() == pytest.approx(np.sqrt(np.pi / 2.0), rel=0.2)


def test_turns_are_spread_over_all_that_are_allowed(rng):
    angle = np.array([np.arccos((np.trace(random_turn(180.0, rng)) - 1.0) / 2.0) for _ in range(400)])
    # Uniform rotations have the density 1 - cos: their mean angle is pi / 2 + 2 / pi.
    assert angle.mean() == pytest.approx(np.pi / 2.0 + 2.0 / np.pi, abs=0.12)


def test_flat_walks_are_as_thick_as_they_say(rig, rng):
    for thickness in (0.01, 1.0):
        flat = camera_points(walked(rig, flat_field(thickness, rng), 100, rng))
        assert 0.8 * thickness < np.ptp(flat[:, 1]) <= thickness
        assert np.ptp(flat[:, 2]) > 10.0
    line = camera_points(walked(rig, one_line(0.01, rng), 100, rng))
    extent = np.linalg.svd(line - line.mean(axis=0), compute_uv=False) / 10.0
    assert extent[0] > 1.0
    assert extent[1] < 0.01


@pytest.mark.parametrize(
    ("model", "view"),
    [("pinhole", 120.0), ("brown_conrady", 90.0), ("kannala_brandt", 60.0), ("kannala_brandt", 200.0)],
)
def test_lenses_see_what_their_field_of_view_says(model, view, rng):
    lens = walked(camera_with_view(model, view, rng), all_round(view, rng), PAIRS, rng)
    x, _, z = camera_points(lens).T
    assert np.degrees(np.abs(np.arctan2(x, z)).max()) == pytest.approx(0.5 * view, rel=0.06)
    columns = lens.marks[:, 0] / lens.image_size[0]
    assert columns.min() < 0.1
    assert columns.max() > 0.9


def test_no_pinhole_sees_a_half_circle(rng):
    with pytest.raises(ValueError, match="pinhole"):
        camera_with_view("pinhole", 180.0, rng)


def test_another_corner_is_where_the_board_has_one(rig, rng):
    marks = other_corner(rig, 0.3, rng)
    bad = np.flatnonzero((marks != rig.marks).any(axis=1))
    assert len(bad) == round(0.3 * PAIRS)
    apex = camera_points(rig)[bad]
    # Back out of the pixel at the apex's depth: a corner is as far below as beside, less some yaw.
    metres = (marks[bad] - rig.marks[bad]) * apex[:, 2:] / rig.truth[6:8]
    near = apex[:, 2] < 12.0
    drop = min(BOARD_EDGES_M, key=lambda edge: abs(edge * np.sqrt(0.5) - np.median(metres[near, 1]))) * np.sqrt(0.5)
    assert np.median(metres[near, 1]) == pytest.approx(drop, rel=0.1)
    assert np.median(np.abs(metres[near, 0])) == pytest.approx(drop, rel=0.2)
    assert len(set(np.sign(metres[near, 0]))) == 1


def test_frames_are_swapped_with_the_next_ones(rig, rng):
    order = in_walking_order(rig)
    steps = np.linalg.norm(np.diff(camera_points(rig)[order][:, [0, 2]], axis=0), axis=1)
    assert np.median(steps) < 3.0
    marks = swapped_neighbours(rig, 0.4, rng)
    moved = np.flatnonzero((marks[order] != rig.marks[order]).any(axis=1))
    assert len(moved) == pytest.approx(0.4 * PAIRS, abs=1)
    assert (moved[1::2] - moved[::2] == 1).all()
    assert np.array_equal(marks[order][moved[::2]], rig.marks[order][moved[1::2]])
    assert sorted(marks.tolist()) == sorted(rig.marks.tolist())


def test_a_run_slips_by_one_frame(rig, rng):
    order = in_walking_order(rig)
    marks = slipped_run(rig, 0.2, rng)
    moved = np.flatnonzero((marks[order] != rig.marks[order]).any(axis=1))
    assert len(moved) == round(0.2 * PAIRS)
    assert (np.diff(moved) == 1).all()
    assert np.array_equal(marks[order][moved], rig.marks[order][moved + 1])


def test_twelve_pairs_are_asked_of_no_model_that_needs_more():
    assert QUESTIONS["pairs"].models_at(12.0) == ("pinhole",)
    assert QUESTIONS["pairs"].models_at(16.0) == MODELS


def test_the_comparison_tells_who_fails():
    rng = np.random.default_rng(3)
    case = case_of(QUESTIONS["mount"], "pinhole", 180.0, rng)
    while np.linalg.norm(case.rig.truth[:3]) < np.radians(160.0):
        case = case_of(QUESTIONS["mount"], "pinhole", 180.0, rng)
    found = compare(case, 1)
    assert not found["ways"]["centre"]["success"]
    assert all(
        found["ways"][name]["success"] and found["ways"][name]["right"] for name in ("ga", "one_slot", "linear")
    )
    assert found["right"]
    assert found["known"]
    assert found["turn_error_deg"] < 0.5
    assert found["place_error_m"] < 0.05


def test_a_walk_at_one_height_gives_an_optimum_that_is_wrong():
    told = answer(("plane", 0, 0), 4)
    assert told["model"] == "pinhole"
    assert told["ways"]["ga"]["success"]
    assert not told["right"]
    assert not told["known"]


def test_shares_come_with_their_intervals(tmp_path):
    assert wilson(24, 24) == (pytest.approx(0.862, abs=1e-3), 1.0)
    assert wilson(12, 24) == (pytest.approx(0.314, abs=1e-3), pytest.approx(0.686, abs=1e-3))
    question = QUESTIONS["view_pinhole"]
    way = {"success": True, "right": True, "seconds": 0.5, "over": 1.0}
    good = {"model": "pinhole", "ways": dict.fromkeys(("ga", "one_slot", "centre", "linear"), way), "right": True}
    good |= {"field_error_px": 0.2, "turn_error_deg": 0.1, "place_error_m": 0.01, "known": True, "beaten": False}
    bad = {**good, "ways": {**good["ways"], "centre": {**way, "success": False}}}
    found = curve(question, [[good, good]] * 3 + [[good, bad]])
    assert found["centre"]["success"] == [1.0, 1.0, 1.0, 0.5]
    assert found["ga"]["success"] == [1.0] * 4
    assert found["optimum"]["right"] == [1.0] * 4
    pytest.importorskip("matplotlib", reason="only the benchmarks draw")
    from benchmarks.worth.figures import draw

    assert draw({"view_pinhole": found}, tmp_path) == ["worth-lens.png"]
    assert (tmp_path / "worth-lens.png").read_bytes().startswith(b"\x89PNG")
