"""The short form of `make bench-coverage`: one recording, some cells; its figures fall if nothing holds."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.coverage.calibrations import Bench, Seen
from benchmarks.coverage.cells import Cell
from benchmarks.coverage.figures import summary
from benchmarks.coverage.marks import Errors, columns
from benchmarks.coverage.runs import recording
from benchmarks.coverage.scores import Score, score
from benchmarks.coverage.walks import pair, walk


@pytest.fixture(scope="module")
def walked():
    return walk(100)


@pytest.mark.slow
def test_what_is_published_holds_in_the_short_form():
    scored = recording(100, ["clean default", "2% default", "prior_t"], 0)
    figures = summary(scored)
    assert len(scored) == 7
    # Seven calibrations of one recording: their six intervals of the mount hold together or not.
    assert np.mean([held for _, one in scored for held in one.held.values()]) > 0.8
    assert figures["sound_accused"] == 0.0
    assert figures["right_model"] >= 0.85
    assert all(one.error_deg < 0.6 and one.error_mm < 30.0 for _, one in scored)


def _scored(name, *, held, doubted=False, bound=None):
    mount = {f"{part}_{axis}": held for part in ("rotation", "t") for axis in "xyz"}
    one = Score(mount, float(held), 1.0, "pinhole", True, "ok", 1.0, doubted, 0.1, 1.0, 0.1, bound)
    return Cell(name, Seen("pinhole"), Errors(), {}), one


def test_the_worst_cell_is_compared_with_chance():
    """Four recordings of five cells: one cell that never holds is far below what chance deals to any."""
    names = ("clean keep", "clean default", "2% keep", "prior_t", "weights")
    alike = [_scored(name, held=number != 0) for number in range(4) for name in names]
    figures = summary(alike)
    assert (figures["worst_coverage95"], figures["worst_by_chance"]) == (0.75, 0.75)
    odd = summary([_scored(name, held=name != "weights") for _ in range(4) for name in names])
    assert odd["worst_coverage95"] == 0.0 and odd["worst_by_chance"] == 0.5


def test_what_no_test_can_name_stands_beside_what_was_named():
    scored = [_scored("four_a_pose", held=True, doubted=True)]
    scored += [_scored("second_half", held=False, doubted=named, bound=0.8) for named in (True, False)]
    scored += [_scored("second_half_960", held=False, bound=0.3), _scored("six_poses", held=False, doubted=True)]
    figures = summary(scored)
    assert figures["shared_error_named"] == pytest.approx(2 / 3, abs=1e-3)
    assert (figures["four_a_pose_named"], figures["second_half_named"]) == (1.0, 0.5)
    assert (figures["second_half_bound"], figures["second_half_960_bound"]) == (0.8, 0.3)
    assert (figures["second_half_960_named"], figures["six_poses_named"]) == (0.0, 1.0)
    assert (figures["worst_coverage95"], figures["six_poses_coverage95"]) == (1.0, 0.0)


@pytest.mark.slow
def test_six_poses_say_what_they_share_and_a_turned_camera_shows_in_an_automotive_one(walked):
    bench = Bench(walked)
    poses = bench.pairs(Seen("pinhole", still=True))
    assert (len(poses.xyz), len(set(poses.pose.tolist())), len(set(poses.corner.tolist()))) == (210, 6, 4)
    assert 0.0005 < np.std(poses.xyz - poses.places(poses.taken_ns)) < 0.02
    request = {"models": ["pinhole"], "folds": 0}
    shared = score(bench.calibrate(Seen("pinhole", still=True), Errors(pose_m=0.01, pose_deg=1.5), request, 0))
    assert shared.doubted and shared.recommended == "pinhole"
    turned = Errors(second_half_deg=0.08)
    bounds = [score(bench.calibrate(Seen("pinhole", finer), turned, request, 0)).bound for finer in (1, 2)]
    assert bounds[0] < 0.9 < bounds[1]


@pytest.mark.slow
def test_wrong_truth_holds_nothing(walked):
    """The scores are of this camera. For a camera 20 cm beside it no interval of the mount holds."""
    done = Bench(walked).calibrate(Seen("pinhole"), Errors(), {"models": ["pinhole"]}, 0)
    assert np.mean(list(score(done).held.values())) > 0.6
    camera = done.paired.camera
    moved = replace(camera, T_camera_lidar=replace(camera.T_camera_lidar, t=camera.T_camera_lidar.t + 0.2))
    beside = replace(done, paired=replace(done.paired, camera=moved))
    assert not any(held for name, held in score(beside).held.items() if name.startswith("t_"))


@pytest.mark.slow
def test_people_mark_as_they_are_said_to(walked):
    paired = pair(walked, "brown_conrady")
    truly = paired.camera.project(paired.walked.poses(paired.taken_ns).apex)

    def off(errors):
        known = columns(paired, errors, np.random.default_rng(1))
        return np.column_stack([known["u"], known["v"]]) - truly, known

    clean, known = off(Errors())
    assert np.std(clean) == pytest.approx(1.0, abs=0.15)
    blunders, _ = off(Errors(blunders=0.1))
    assert 0.04 < np.mean(np.hypot(*blunders.T) > 6.0) < 0.16
    turned, _ = off(Errors(second_half_deg=0.08))
    late = paired.taken_ns > np.median(paired.taken_ns)
    moved = turned - clean
    assert np.abs(moved[~late]).max() < 1e-9 and 0.3 < np.median(np.abs(moved[late, 0])) < 1.5
    _, posed = off(Errors(pose_m=0.01))
    assert posed["group"] == (np.arange(len(truly)) // 4).tolist()
    assert np.std(np.array(posed["x"]) - known["x"]) == pytest.approx(0.01, rel=0.5)
