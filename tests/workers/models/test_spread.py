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
    names, squares = list(deviations), [(value or 0.0) ** 2 for value in deviations.values()]
    turned = Rotation.from_rotvec(np.radians(turn_deg)) * AHEAD
    return FitResult.model_validate(
        fit_result(
            status=status,
            transform=to_document(SE3("camera", "velodyne", turned.as_matrix(), np.array(t))),
            intrinsics=lens,
            std=deviations,
            covariance={"names": names, "units": [""] * len(names), "matrix": np.diag(squares).tolist()},
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
    added = np.array(spread.covariance.matrix) - np.array(RESULTS["pinhole"].covariance.matrix)
    rows = [spread.covariance.names.index(name) for name in ("rotation_x", "t_z")]
    np.testing.assert_allclose(added[np.ix_(rows, rows)], 0.25 * np.outer([0.3, 0.01], [0.3, 0.01]))
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


@pytest.mark.parametrize("weight", [1e-6, 0.02, 0.2, 0.5])
def test_no_deviation_is_larger_than_its_interval_and_coefficients_of_another_model_do_not_mix(weight):
    """k3 of a fisheye is no tangential term, and its deviation is another one."""
    own = result([0.0, 0.0, 0.0], [0.1, 0.2, 0.3], 600.0, 0.05, k3=0.001, k4=0.002)
    other = result([3.0, 1.0, 0.0], [0.5, 0.2, 0.31], 603.0, 0.05, k3=0.4, k4=0.1)
    spread = spread_of(
        "pinhole", {"pinhole": own, "brown_conrady": other}, {"pinhole": 1 - weight, "brown_conrady": weight}
    )
    assert all(spread.std[name] <= spread.interval95_half_width[name] for name in own.std)
    assert (spread.std["k3"], spread.std["k4"]) == (0.001, 0.002)
    assert spread.interval95_half_width["k3"] == pytest.approx(0.002)


def test_nothing_is_said_or_added_where_the_other_model_is_ruled_out_or_open():
    ruled_out = spread_of("pinhole", RESULTS, {"pinhole": 1.0, "brown_conrady": 0.0})
    assert ruled_out.std == pytest.approx(RESULTS["pinhole"].std)
    assert ruled_out.interval95_half_width == pytest.approx(RESULTS["pinhole"].interval95_half_width)
    assert spread_sentence("pinhole", RESULTS, ruled_out) is None
    open_ = RESULTS | {"brown_conrady": RESULTS["brown_conrady"].model_copy(update=OPEN)}
    assert spread_of("pinhole", open_, {"pinhole": 0.5, "brown_conrady": 0.5}) is None
    assert spread_of("pinhole", {"pinhole": RESULTS["pinhole"]}, {"pinhole": 1.0}) is None


def test_the_prediction_counts_where_the_other_model_puts_points():
    """A turn by 0.3 degrees about x moves the middle by f tan(0.3) px and d sin(0.3); the corner has no ray."""
    stated = {"stated_px": [0.4, 0.3], "stated_mm": [3.0, 10.0]}
    none = {"stated_px": None, "stated_mm": None}
    points = [{"u": 640.0, "v": 480.0} | stated, {"u": 0.0, "v": 0.0} | none]
    prediction = {"distances_m": [5.0, 20.0], "expected_over_stated": 1.5, "points": points}
    models = {
        name: FitResult.model_validate(
            result([turn_deg, 0.0, 0.0], [0.0] * 3, 600.0, 0.05).model_dump() | {"prediction": prediction}
        )
        for name, turn_deg in {"pinhole": 0.0, "brown_conrady": 0.3}.items()
    }
    mixture = spread_of("pinhole", models, {"pinhole": 0.75, "brown_conrady": 0.25}).prediction
    turn = np.radians(0.3)
    assert mixture.points[0].stated_px == pytest.approx(np.hypot([0.4, 0.3], 0.5 * 600.0 * np.tan(turn)))
    assert mixture.points[0].stated_mm == pytest.approx(
        np.hypot([3.0, 10.0], 0.5 * 1e3 * np.array([5.0, 20.0]) * np.sin(turn))
    )
    assert (mixture.points[1].stated_px, mixture.expected_over_stated) == (None, 1.5)
    ruled_out = spread_of("pinhole", models, {"pinhole": 1.0, "brown_conrady": 0.0}).prediction
    assert ruled_out.points[0].stated_mm == pytest.approx([3.0, 10.0])


def test_what_is_not_determined_stays_so():
    lost = RESULTS | {"pinhole": result([0.0, 0.0, 0.0], [0.1, 0.2, 0.3], 600.0, 0.05, t_x=None)}
    spread = spread_of("pinhole", lost, {"pinhole": 0.5, "brown_conrady": 0.5})
    assert spread.std["t_x"] is None and spread.interval95_half_width["t_x"] is None


def test_nothing_is_added_where_a_model_that_takes_no_part_has_all_weight():
    models = RESULTS | {"kannala_brandt": RESULTS["pinhole"].model_copy(update=OPEN)}
    weight = {"pinhole": 0.0, "brown_conrady": 0.0, "kannala_brandt": 1.0}
    assert spread_of("pinhole", models, weight) is None
    assert spread_of("kannala_brandt", models, weight).std == pytest.approx(models["kannala_brandt"].std)
