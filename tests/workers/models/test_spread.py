"""What a result states if another model that is not ruled out differs in the mount."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from apexcal.documents.results import FitResult
from apexcal.geometry.se3 import SE3, to_document
from tests.support.results import fit_result
from workers.models.spread import spread_of, spread_sentence

OPEN = {"status": "not_determined"}
NAMES = ["rotation_x", "rotation_y", "rotation_z", "t_x", "t_y", "t_z", "f_x"]


def result(turn_deg, t, f_x, std, status="ok", **std_of):
    deviations = dict(zip(NAMES, [std] * 3 + [0.002] * 3 + [1.0], strict=True)) | std_of
    lens = {"model": "pinhole", "f_x": f_x, "f_y": 600.0, "c_x": 640.0, "c_y": 480.0, "image_size": [1280, 960]}
    turned = Rotation.from_rotvec(np.radians(turn_deg)) * AHEAD
    return FitResult.model_validate(
        fit_result(
            status=status,
            transform=to_document(SE3("camera", "velodyne", turned.as_matrix(), np.array(t))),
            intrinsics=lens,
            std=deviations,
            interval95_half_width={
                name: None if value is None else 2.0 * value for name, value in deviations.items()
            },
        )
    )


AHEAD = Rotation.from_rotvec(np.radians([0.0, 90.0, 0.0]))
RESULTS = {
    "pinhole": result([0.0, 0.0, 0.0], [0.1, 0.2, 0.3], 600.0, 0.05),
    "brown_conrady": result([0.3, 0.0, 0.0], [0.1, 0.2, 0.31], 603.0, 0.05),
}


def test_the_mixtures_moment_and_quantile_are_stated():
    spread = spread_of("pinhole", RESULTS, {"pinhole": 0.75, "brown_conrady": 0.25})
    assert spread.std["rotation_x"] == pytest.approx(np.hypot(0.05, np.sqrt(0.25) * 0.3))
    assert spread.std["rotation_y"] == pytest.approx(0.05)
    assert spread.std["t_z"] == pytest.approx(np.hypot(0.002, 0.5 * 0.01))
    assert spread.std["f_x"] == pytest.approx(np.hypot(1.0, 0.5 * 3.0))
    # A fifth of the other model's quarter lies farther off; its interval of 4 mm is 1.96 deviations.
    assert spread.interval95_half_width["t_z"] == pytest.approx(0.01 + 0.8416 * 0.004 / 1.96, rel=1e-4)
    assert spread.interval95_half_width["t_y"] == pytest.approx(0.004)
    said = spread_sentence("pinhole", RESULTS, spread)
    assert "brown_conrady (weight 0.25) puts the mount 0.30 degrees and 10 mm from where pinhole does" in said
    assert "6.0 deviations" in said


@pytest.mark.parametrize("weight", [0.02, 0.06, 0.2, 0.5])
def test_intervals_hold_their_share_of_a_mixture_of_two_peaks(weight):
    spread = spread_of("pinhole", RESULTS, {"pinhole": 1.0 - weight, "brown_conrady": weight})
    random = np.random.default_rng(3)
    is_other = random.uniform(size=40_000) < weight
    draws = np.where(is_other, 0.3, 0.0) + 0.1 / 1.96 * random.normal(size=is_other.size)
    held = np.mean(np.abs(draws) <= spread.interval95_half_width["rotation_x"])
    assert held == pytest.approx(0.95, abs=0.004)


def test_nothing_is_said_or_added_where_the_other_model_is_ruled_out_or_open():
    ruled_out = spread_of("pinhole", RESULTS, {"pinhole": 1.0, "brown_conrady": 0.0})
    assert ruled_out.std == pytest.approx(RESULTS["pinhole"].std)
    assert ruled_out.interval95_half_width == pytest.approx(RESULTS["pinhole"].interval95_half_width)
    assert spread_sentence("pinhole", RESULTS, ruled_out) is None
    open_ = RESULTS | {"brown_conrady": RESULTS["brown_conrady"].model_copy(update=OPEN)}
    assert spread_of("pinhole", open_, {"pinhole": 0.5, "brown_conrady": 0.5}) is None
    assert spread_of("pinhole", {"pinhole": RESULTS["pinhole"]}, {"pinhole": 1.0}) is None


def test_what_is_not_determined_stays_so():
    lost = RESULTS | {"pinhole": result([0.0, 0.0, 0.0], [0.1, 0.2, 0.3], 600.0, 0.05, t_x=None)}
    spread = spread_of("pinhole", lost, {"pinhole": 0.5, "brown_conrady": 0.5})
    assert spread.std["t_x"] is None and spread.interval95_half_width["t_x"] is None


def test_nothing_is_added_where_a_model_that_takes_no_part_has_all_weight():
    models = RESULTS | {"kannala_brandt": RESULTS["pinhole"].model_copy(update=OPEN)}
    weight = {"pinhole": 0.0, "brown_conrady": 0.0, "kannala_brandt": 1.0}
    assert spread_of("pinhole", models, weight) is None
    assert spread_of("kannala_brandt", models, weight).std == pytest.approx(models["kannala_brandt"].std)
