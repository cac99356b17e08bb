"""The short form of `make bench-coverage`: one recording, some cells; its figures fall if nothing holds."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.coverage.calibrations import Bench, Seen
from benchmarks.coverage.figures import summary
from benchmarks.coverage.marks import Errors, columns
from benchmarks.coverage.runs import recording
from benchmarks.coverage.scores import score
from benchmarks.coverage.walks import pair, walk


@pytest.fixture(scope="module")
def walked():
    return walk(100)


@pytest.mark.slow
def test_what_is_published_holds_in_the_short_form():
    scored = recording(100, ["clean exclude", "2% exclude", "prior_t"], 0)
    figures = summary(scored)
    assert len(scored) == 7
    # Seven calibrations of one recording: their six intervals of the mount hold together or not.
    assert np.mean([held for _, one in scored for held in one.held.values()]) > 0.8
    assert figures["sound_accused"] == 0.0
    assert figures["right_model"] >= 0.85
    assert all(one.error_deg < 0.6 and one.error_mm < 30.0 for _, one in scored)


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
