"""What a score of other pairs says, against residuals drawn with what the calibration states."""

from dataclasses import replace

import numpy as np
import pytest

from apexcal.documents.errors import GeometryError
from workers.validation.calibration import KnownCalibration
from workers.validation.pair_score import score_pairs

LENS = {"model": "brown_conrady", "f_x": 900.0, "f_y": 905.0, "c_x": 640.0, "c_y": 360.0, "skew": 0.0}
LENS |= {"k1": -0.05, "k2": 0.01, "k3": 0.001, "k4": -0.001, "k5": 0.0, "image_size": [1280, 720]}
LEVEL = {
    "to_frame": "camera",
    "from_frame": "lidar",
    "rotation": {"matrix": [[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]},
    "translation_m": [0.05, -0.1, -0.2],
}
NAMES = ["rotation_x", "rotation_y", "rotation_z", "t_x", "t_y", "t_z", "f_x", "c_x"]
STD = np.array([0.03, 0.03, 0.05, 0.01, 0.01, 0.02, 1.5, 0.8])  # degrees, metres, px
SIGMA_PX = 1.0


def calibration(**changed):
    covariance = {"names": NAMES, "units": ["deg"] * 3 + ["m"] * 3 + ["px"] * 2, "matrix": np.diag(STD**2).tolist()}
    return KnownCalibration.of(
        {"intrinsics": LENS, "transform": LEVEL, "covariance": covariance, "sigma_px": SIGMA_PX} | changed
    )


def points(rng, count=150):
    x = rng.uniform(5.0, 30.0, count)
    return np.column_stack([x, x * rng.uniform(-0.5, 0.5, count), x * rng.uniform(-0.25, 0.25, count)])


def drawn(rng, known, turn_deg=(0, 0, 0), noise=SIGMA_PX):
    """A vehicle whose true calibration is off by what is stated, and further by a turn; and its marks."""
    d = rng.normal(0.0, STD)
    truth = known.moved(d[:3] + np.array(turn_deg), d[3:6])
    truth = replace(truth, intrinsics=known.intrinsics + np.array([d[6], 0, d[7], 0, 0, 0, 0, 0, 0, 0]))
    where = points(rng)
    pixels, _ = truth.project(where)
    return where, pixels + rng.normal(0.0, noise, pixels.shape)


def test_the_errors_are_the_plain_distances():
    known, rng = calibration(), np.random.default_rng(1)
    where, marks = drawn(rng, known)
    found = score_pairs(known, where, marks)
    distances = np.hypot(*(known.project(where)[0] - marks).T)
    assert found["mean_px"] == pytest.approx(distances.mean())
    assert found["rms_px"] == pytest.approx(np.sqrt(np.mean(distances**2)))
    assert np.hypot(found["residual_u"], found["residual_v"]) == pytest.approx(distances, abs=1e-3)


def test_jacobians_are_those_of_the_projection():
    known, rng = calibration(), np.random.default_rng(2)
    where = points(rng, 20)
    by_mount, by_stated = known.jacobians(where)
    for column, step in enumerate(1e-6 * np.eye(6)):
        ahead, behind = (
            known.moved(sign * np.degrees(step[:3]), sign * step[3:]).project(where)[0] for sign in (1, -1)
        )
        turned = (ahead - behind) / 2e-6
        # A turn of the mount about the camera's origin moves its translation too; the columns leave t where it is.
        if column < 3:
            at = known.mount.t
            turned -= by_mount[:, :, 3:] @ np.cross(step[:3] / 1e-6, at)
        assert by_mount[:, :, column] == pytest.approx(turned, rel=1e-4, abs=1e-3)
    assert by_stated[:, :, 6][:, 1] == pytest.approx(0.0)  # f_x moves u alone


def test_sound_calibrations_are_seldom_accused_and_turned_ones_named():
    known, rng = calibration(), np.random.default_rng(3)
    sound = [score_pairs(known, *drawn(rng, known)) for _ in range(200)]
    assert sum(one["verdict"] == "disagrees" for one in sound) <= 2
    # Chi-square of six freedoms: the root mean square of the sigmas is 1.
    assert np.sqrt(np.mean([one["sigmas"] ** 2 for one in sound])) == pytest.approx(1.0, abs=0.15)
    for turn in ([0.5, 0, 0], [0, 0.5, 0], [0, 0, 1.0]):
        turned = [score_pairs(known, *drawn(rng, known, turn)) for _ in range(20)]
        assert all(one["verdict"] == "disagrees" for one in turned)
        assert np.median([one["turn_deg"] for one in turned]) == pytest.approx(np.linalg.norm(turn), rel=0.3)


def test_the_noise_of_the_pairs_themselves_is_part_of_what_is_stated():
    """An almost exact calibration: the marks alone move the apparent mount, by A, and the bias, by their mean."""
    covariance = {"names": NAMES, "units": ["deg"] * 3 + ["m"] * 3 + ["px"] * 2}
    exact = calibration(covariance=covariance | {"matrix": np.diag((1e-4 * STD) ** 2).tolist()})
    rng = np.random.default_rng(8)
    found = []
    for _ in range(150):
        where = points(rng, 30)
        marks, _ = exact.project(where)
        found.append(score_pairs(exact, where, marks + rng.normal(0.0, SIGMA_PX, marks.shape)))
    # Six freedoms, 150 draws: the mean square has a standard deviation of sqrt(2 / 900) = 0.05. The noise of 30 pairs
    # is taken if it is larger than what is stated, so the mean lies a little below 1.
    assert np.mean([one["sigmas"] ** 2 for one in found]) == pytest.approx(0.93, abs=0.2)
    assert sum(one["verdict"] == "disagrees" for one in found) <= 1
    sure = np.array([one["bias_sigma_px"] for one in found])
    assert (sure >= SIGMA_PX / np.sqrt(30.0) - 1e-6).all() and sure.max() < 1.6 * SIGMA_PX / np.sqrt(30.0)


def test_noise_beyond_what_is_stated_is_named_and_wrong_marks_are_counted():
    known, rng = calibration(), np.random.default_rng(4)
    noisy = score_pairs(known, *drawn(rng, known, noise=3.0))
    assert noisy["verdict"] == "disagrees" and "noise is 3" in noisy["sentence"].replace("2.9", "3")
    where, marks = drawn(rng, known)
    marks[:6] += 200.0
    found = score_pairs(known, where, marks)
    assert (found["wrong"], found["verdict"]) == (6, "agrees")
    assert found["is_wrong"][:6] == [True] * 6


def test_what_states_nothing_or_has_few_pairs_is_unknown():
    rng = np.random.default_rng(5)
    bare = calibration(covariance=None, sigma_px=None)
    where, marks = drawn(rng, bare)
    assert score_pairs(bare, where, marks)["verdict"] == "unknown"
    few = score_pairs(calibration(), where[:4], marks[:4])
    assert (few["verdict"], few["noise_px"]) == ("unknown", None)
    behind = where * [-1.0, 1.0, 1.0]
    assert score_pairs(calibration(), behind, marks)["forbidden"] == len(behind)
    with pytest.raises(GeometryError, match="no pairs"):
        score_pairs(calibration(), where[:0], marks[:0])


def test_noise_is_named_from_one_and_a_half_times_what_is_stated():
    known, rng = calibration(), np.random.default_rng(9)
    # 300 coordinates know their deviation to 4 %.
    verdicts = {
        noise: [score_pairs(known, *drawn(rng, known, noise=noise)) for _ in range(5)] for noise in (1.3, 1.75)
    }
    assert all(one["verdict"] == "agrees" for one in verdicts[1.3])
    assert all("their noise is" in one["sentence"] for one in verdicts[1.75])
