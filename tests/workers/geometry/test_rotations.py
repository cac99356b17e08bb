import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from workers.geometry.errors import GeometryError
from workers.geometry.rotations import (
    EULER_ORDERS,
    FORWARD_LIDAR_TO_OPTICAL,
    axes_of_euler,
    axes_of_vector,
    check_rotation,
    euler_from_rotation,
    quaternion_from_rotation,
    rotation_from_euler,
    rotation_from_quaternion,
    rotation_from_vector,
    rows_from_euler,
    rows_from_vector,
    vector_from_rotation,
)

angle = st.floats(-3.2, 3.2)
angles = st.tuples(angle, angle, angle)


def about(axis, a):
    c, s = np.cos(a), np.sin(a)
    return {
        "x": np.array([[1, 0, 0], [0, c, -s], [0, s, c]]),
        "y": np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
        "z": np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]),
    }[axis]


@settings(deadline=None)
@given(angles)
def test_orders_are_the_written_products(abc):
    a, b, g = abc
    np.testing.assert_allclose(rotation_from_euler(abc), about("z", a) @ about("y", b) @ about("x", g), atol=1e-14)
    expected = about("x", a) @ about("y", b) @ about("z", g)
    np.testing.assert_allclose(rotation_from_euler(abc, "xyz_eq2"), expected, atol=1e-14)


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


def test_camera_tilted_down_has_beta_minus_105():
    down = rotation_from_vector([np.radians(15), 0, 0]) @ FORWARD_LIDAR_TO_OPTICAL
    candidate = rotation_from_euler(np.radians([90, -105, 0]))
    np.testing.assert_allclose(candidate, down, atol=1e-12)
    # A point below the horizon ahead is nearer to the image's centre row for a camera that looks down.
    assert abs((down @ [10, 0, -2.68])[1]) < 0.01


@settings(deadline=None)
@given(angles)
def test_rotation_vector_agrees_with_opencv_and_returns(w):
    R = rotation_from_vector(w)
    np.testing.assert_allclose(R, cv2.Rodrigues(np.array(w))[0], atol=1e-9)
    np.testing.assert_allclose(rotation_from_vector(vector_from_rotation(R)), R, atol=1e-9)


@settings(deadline=None)
@given(angles)
def test_compiled_rows_agree(abc):
    np.testing.assert_allclose(np.reshape(rows_from_vector(*abc), (3, 3)), rotation_from_vector(abc), atol=1e-12)
    np.testing.assert_allclose(np.reshape(rows_from_euler(*abc), (3, 3)), rotation_from_euler(abc), atol=1e-12)


@settings(deadline=None)
@given(angles)
def test_axes_are_the_derivative_of_the_rotation(abc):
    point, step = np.array([0.3, -0.7, 0.5]), 1e-6
    for rows, axes in (
        (rows_from_vector, axes_of_vector(*abc)),
        (rows_from_euler, axes_of_euler(abc[0], abc[1])),
    ):
        moved = np.reshape(rows(*abc), (3, 3)) @ point
        for i in range(3):
            d = np.zeros(3)
            d[i] = step
            ahead, back = (np.reshape(rows(*(np.array(abc) + s * d)), (3, 3)) @ point for s in (1, -1))
            axis = np.reshape(axes, (3, 3))[:, i]
            np.testing.assert_allclose(np.cross(axis, moved), (ahead - back) / (2 * step), atol=1e-8)


@settings(deadline=None)
@given(angles)
def test_quaternion_round_trip(w):
    R = rotation_from_vector(w)
    np.testing.assert_allclose(rotation_from_quaternion(quaternion_from_rotation(R)), R, atol=1e-14)


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


def test_unknown_order_is_refused():
    with pytest.raises(GeometryError, match="xyz_eq2"):
        rotation_from_euler([0, 0, 0], "xyz")


def test_a_camera_tilted_down_reads_as_in_the_papers_box():
    R = rotation_from_euler(np.radians([90.0, -105.0, 0.0]))
    np.testing.assert_allclose(np.degrees(euler_from_rotation(R)), [90.0, -105.0, 0.0], atol=1e-9)


@pytest.mark.parametrize("shared", [rows_from_vector, rows_from_euler])
def test_bits_do_not_depend_on_who_was_compiled_first(shared):
    def nine(inner):
        return lambda v: inner(v[0], v[1], v[2])

    vectors = np.random.default_rng(0).normal(size=(300, 3))
    said = {name: shared.targetoptions[name] for name in ("nogil", "error_model", "fastmath")}
    afresh = [njit(**said)(shared.py_func) for _ in range(2)]
    hasty = njit(fastmath=True)(nine(afresh[0]))
    hasty(vectors[0])
    plain = [njit(nine(one)) for one in afresh]
    assert [plain[0](v) for v in vectors] == [plain[1](v) for v in vectors]
