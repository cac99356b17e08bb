import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import linalg

from apexcal.documents.errors import GeometryError
from apexcal.documents.transforms import Transform
from apexcal.geometry.rotations import rotation_from_euler, rotation_from_vector
from apexcal.geometry.se3 import SE3, from_document, to_document

number = st.floats(-3.0, 3.0)
triple = st.tuples(number, number, number)
small = st.floats(-1.7, 1.7)
twist = st.tuples(small, small, small, number, number, number).map(np.array)


@st.composite
def transforms(draw, to_frame="a", from_frame="b"):
    return SE3(to_frame, from_frame, rotation_from_vector(draw(triple)), np.array(draw(triple)))


@given(transforms("a", "b"), transforms("b", "c"), transforms("c", "d"), triple)
def test_group_axioms(T_a_b, T_b_c, T_c_d, point):
    left, right = (T_a_b @ T_b_c) @ T_c_d, T_a_b @ (T_b_c @ T_c_d)
    assert (left.to_frame, left.from_frame) == ("a", "d")
    np.testing.assert_allclose(left.apply(point), right.apply(point), atol=1e-12)
    np.testing.assert_allclose((T_a_b @ T_b_c).apply(point), T_a_b.apply(T_b_c.apply(point)), atol=1e-12)
    there_and_back = T_a_b.inverse() @ T_a_b
    assert (there_and_back.to_frame, there_and_back.from_frame) == ("b", "b")
    np.testing.assert_allclose(there_and_back.apply(point), point, atol=1e-12)


@given(transforms())
def test_document_keeps_every_bit_and_all_its_forms_agree(T):
    document = json.loads(json.dumps(to_document(T)))
    back = from_document(document)
    assert back.R.tobytes() == T.R.tobytes()
    assert back.t.tobytes() == T.t.tobytes()
    rotation = document["rotation"]
    for form in ({"quaternion_xyzw": rotation["quaternion_xyzw"]}, *rotation["euler"]):
        np.testing.assert_allclose(from_document(document | {"rotation": form}).R, T.R, atol=1e-6)


def test_direction_is_to_from():
    document = {
        "to_frame": "camera_front_optical",
        "from_frame": "velodyne",
        "rotation": {"euler_order": "zyx", "angles_deg": [90, -90, 0]},
        "translation_m": [0.1, 0.2, 0.3],
    }
    T_camera_lidar = from_document(document)
    # One metre ahead and a bit to the left of the LiDAR: ahead is z, left is -x.
    np.testing.assert_allclose(T_camera_lidar.apply([1.0, 0.5, 0.0]), [-0.5 + 0.1, 0.2, 1.3], atol=1e-15)


def test_frames_must_meet():
    T = SE3("camera", "velodyne")
    with pytest.raises(GeometryError, match="cannot follow") as caught:
        T @ T
    assert caught.value.code == "frames_do_not_meet"


def test_values_are_read_only():
    T = SE3("camera", "velodyne")
    with pytest.raises(ValueError, match="read-only"):
        T.t[0] = 1.0


@pytest.mark.parametrize(
    "broken",
    [
        {"rotation": {"matrix": [[1, 0], [0, 1]]}},
        {"rotation": {"matrix": [[1, 0, 0], [0, 1, 0], [0, 0, -1]]}},
        {"rotation": {"quaternion_xyzw": [0, 0, 0, 0]}},
        {"rotation": {"angles_deg": [0, float("nan"), 0], "euler_order": "zyx"}},
        {"translation_m": [1]},
        {"translation_m": [1, 2, float("inf")]},
    ],
)
def test_what_is_no_transform_is_refused_with_words(broken):
    with pytest.raises(GeometryError) as caught:
        from_document(to_document(SE3("a", "b")) | broken)
    assert caught.value.message


def exponential(xi):
    """(4, 4), by SciPy."""
    generator = np.zeros((4, 4))
    generator[:3, 3] = xi[3:]
    generator[:3, :3] = [[0, -xi[2], xi[1]], [xi[2], 0, -xi[0]], [-xi[1], xi[0], 0]]
    return linalg.expm(generator)


@given(transforms("a", "b"), twist)
def test_the_adjoint_carries_twists_between_the_frames(T, xi):
    there_and_back = T.matrix @ exponential(xi) @ T.inverse().matrix
    np.testing.assert_allclose(there_and_back, exponential(T.adjoint() @ xi), atol=1e-9)


@pytest.mark.parametrize("beta", [-90.0, 90.0])
@pytest.mark.parametrize("order", ["zyx", "xyz_eq2"])
def test_angles_at_their_singular_point_still_give_the_rotation(beta, order):
    T = SE3("a", "b", rotation_from_euler(np.radians([30.0, beta, -20.0]), order))
    for form in to_document(T)["rotation"]["euler"]:
        np.testing.assert_allclose(from_document(to_document(T) | {"rotation": form}).R, T.R, atol=1e-9)


def test_a_transform_as_results_say_it_is_taken_as_a_mount():
    said = to_document(SE3("camera", "velodyne", rotation_from_euler(np.radians([90, -105, 0]))))
    assert list(Transform.model_validate(said).rotation.model_dump()) == ["matrix"]


def test_roll_pitch_yaw_turn_about_fixed_axes():
    roll, pitch, yaw = SE3("a", "b", rotation_from_euler([0.3, -0.2, 0.1])).roll_pitch_yaw
    np.testing.assert_allclose([roll, pitch, yaw], [0.1, -0.2, 0.3])
