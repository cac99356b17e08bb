import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from apexcal.documents.errors import GeometryError
from apexcal.geometry.rotations import (
    EULER_ORDERS,
    FORWARD_LIDAR_TO_OPTICAL,
    check_rotation,
    euler_from_rotation,
    quaternion_from_rotation,
    rotation_from_euler,
    rotation_from_vector,
    vector_from_rotation,
)

angle = st.floats(-3.2, 3.2)
angles = st.tuples(angle, angle, angle)


@pytest.mark.parametrize("order", EULER_ORDERS)
@settings(deadline=None)
@given(abc=angles)
def test_euler_angles_come_back_as_the_same_rotation(order, abc):
    R = rotation_from_euler(abc, order)
    np.testing.assert_allclose(rotation_from_euler(euler_from_rotation(R, order), order), R, atol=1e-7)


def test_centre_of_table_1_is_the_forward_lidar():
    R = rotation_from_euler([np.pi / 2, -np.pi / 2, 0.0])
    np.testing.assert_allclose(R, FORWARD_LIDAR_TO_OPTICAL, atol=1e-15)
    np.testing.assert_allclose(euler_from_rotation(FORWARD_LIDAR_TO_OPTICAL), [np.pi / 2, -np.pi / 2, 0.0])


@pytest.mark.parametrize("matrix", [np.eye(2), np.diag([1.0, 1.0, -1.0]), 1.1 * np.eye(3), np.full((3, 3), np.nan)])
def test_what_is_no_rotation_is_refused(matrix):
    with pytest.raises(GeometryError) as caught:
        check_rotation(matrix)
    assert caught.value.code == "bad_rotation"


def test_rounded_digits_are_repaired():
    rounded = np.round(rotation_from_vector([0.1, 0.2, 0.3]), 4)
    repaired = check_rotation(rounded)
    np.testing.assert_allclose(repaired @ repaired.T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(repaired, rounded, atol=1e-4)


@pytest.mark.parametrize("order", EULER_ORDERS)
def test_the_formulas_are_those_of_scipy(order):
    sequence = {"zyx": "ZYX", "xyz_eq2": "XYZ"}[order]
    rng = np.random.default_rng(7)
    for size in 10.0 ** rng.uniform(-9.0, 0.5, 300):
        w = size * rng.normal(size=3)
        peer = Rotation.from_rotvec(w)
        R = peer.as_matrix()
        np.testing.assert_allclose(rotation_from_vector(w), R, rtol=0.0, atol=1e-15)
        np.testing.assert_allclose(vector_from_rotation(R), Rotation.from_matrix(R).as_rotvec(), rtol=1e-14)
        expected = Rotation.from_matrix(R).as_quat(canonical=True)
        np.testing.assert_allclose(quaternion_from_rotation(R), expected, rtol=0.0, atol=1e-15)
        turned = rotation_from_euler(w, order)
        np.testing.assert_allclose(turned, Rotation.from_euler(sequence, w).as_matrix(), rtol=0.0, atol=1e-15)
