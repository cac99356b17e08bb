"""Two results of one vehicle: how far apart, and whether both can be right."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from apexcal.documents.results import ComparedResult
from apexcal.geometry.result_differences import compared, side_by_side
from apexcal.geometry.se3 import SE3, to_document

NAMES = ["rotation_x", "rotation_y", "rotation_z", "t_x", "t_y", "t_z", "f_x"]
C = np.diag([0.05, 0.04, 0.03, 0.004, 0.005, 0.006, 1.0]) ** 2
C[0, 4] = C[4, 0] = 0.9 * 0.05 * 0.005


def result(turn_deg, t, u=0.0, number=(3, 5, 9), **members):
    turned = Rotation.from_rotvec(np.radians(turn_deg)) * Rotation.from_euler("y", 80, degrees=True)
    lens = {"model": "pinhole", "f_x": 600.0, "f_y": 600.0, "c_x": 300.0 + u, "c_y": 200.0, "k1": 0.1}
    return ComparedResult.model_validate(
        {
            "transform": to_document(SE3("camera", "velodyne", turned.as_matrix(), np.array(t))),
            "intrinsics": lens | {"image_size": [640, 480]},
            "lens": "fitted",
            "std": dict(zip(NAMES, np.sqrt(np.diag(C)).tolist(), strict=True)),
            "covariance": {"names": NAMES, "units": [], "matrix": C.tolist()},
            "field": {
                "number": number,
                "u": [10.0 + u, 20.0 + u, 30.0],
                "v": [1.0, 2.0, 3.0],
                "sigma_px": [0.5, 1.0, 2.0],
            },
        }
        | members
    )


def test_the_difference_counts_in_what_both_state():
    one, other = result([0.0, 0.0, 0.0], [0.1, 0.2, 0.3]), result([0.02, 0.01, 0.0], [0.1, 0.203, 0.3])
    found = compared(one, other)
    assert found.rotation_deg == pytest.approx(np.hypot(0.02, 0.01), rel=1e-6)
    assert found.translation_mm == pytest.approx(3.0)
    d = np.array([-0.02, -0.01, 0.0, 0.0, -0.003, 0.0])
    assert found.sigmas == pytest.approx(np.sqrt(d @ np.linalg.inv(2 * C[:6, :6]) @ d / 6), rel=1e-6)
    assert not found.differs


def test_half_a_degree_is_no_chance_unless_other_models_say_so():
    one, other = result([0.0, 0.0, 0.0], [0.1, 0.2, 0.3]), result([0.4, 0.0, 0.0], [0.1, 0.2, 0.314])
    assert compared(one, other).differs
    wide = one.model_copy(update={"std": one.std | {"rotation_x": 0.5, "t_z": 0.05}})
    assert not compared(wide, other).differs


def test_the_field_is_compared_where_both_see_it():
    one, other = result([0.0] * 3, [0.0] * 3), result([0.0] * 3, [0.0] * 3, u=3.0, number=[5, 9, 11])
    found = compared(one, other)
    # Points 5 and 9: u 20 against 13 and 30 against 23; v 2 against 1 and 3 against 2.
    assert found.field_px == pytest.approx(np.sqrt(((20 - 13) ** 2 + 1 + (30 - 23) ** 2 + 1) / 2))
    sigma = np.array([np.hypot(1.0, 0.5), np.hypot(2.0, 1.0)])
    assert found.field_sigmas == pytest.approx(np.sqrt(np.mean(50.0 / (2 * sigma**2))))


def test_results_without_a_field_and_without_deviations():
    one, other = result([0.0] * 3, [0.0] * 3), result([0.1, 0.0, 0.0], [0.0] * 3, field=None)
    assert compared(one, other).field_px is None
    assert compared(one, result([0.1, 0.0, 0.0], [0.0] * 3, std={})) is None


def test_two_results_side_by_side():
    number = [3, 611, 612]
    one = result([0.0, 0.0, 0.0], [0.1, 0.2, 0.3], number=number)
    other = result([0.02, 0.0, 0.0], [0.1, 0.203, 0.3], u=3.0, number=number)
    found = side_by_side(one, other)
    by_name = {each.name: each for each in found["parameters"]}
    turn, t_y = by_name["rotation_x"], by_name["t_y"]
    assert (turn.unit, turn.difference) == ("deg", pytest.approx(-0.02))
    assert (t_y.unit, t_y.difference) == ("mm", pytest.approx(-3.0))
    assert t_y.std == pytest.approx(5.0 * 2**0.5) and t_y.sigmas == pytest.approx(3.0 / (5.0 * 2**0.5))
    # No deviation of c_x and k1 is stated; k1 means the same in both models.
    assert (by_name["c_x"].difference, by_name["c_x"].sigmas) == (-3.0, None)
    assert by_name["k1"].difference == 0.0
    field = found["field"]
    # Points are counted by range first: 612 at 5 m, then those at 20 m.
    assert field.distance_m == [5.0, 5.0, 20.0]
    assert field.du == [-3.0, -3.0, 0.0] and field.dv == [0.0, 0.0, 0.0]
    assert field.sigma_px == pytest.approx([2**0.5 * sigma for sigma in (0.5, 1.0, 2.0)])
    assert found["field_px"] == pytest.approx((2 * 9 / 3) ** 0.5)


def test_two_models_side_by_side_and_one_without_deviations():
    one, other = result([0.0] * 3, [0.0] * 3), result([0.1, 0.0, 0.0], [0.0] * 3, std={}, field=None)
    other.intrinsics.model = "kannala_brandt"
    found = side_by_side(one, other)
    assert found["rotation_deg"] == pytest.approx(0.1)
    assert (found["sigmas"], found["differs"], found["field"], found["field_px"]) == (None, None, None, None)
    assert "k1" not in [each.name for each in found["parameters"]]
