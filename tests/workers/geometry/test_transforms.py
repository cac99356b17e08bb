import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from workers.geometry.errors import GeometryError
from workers.geometry.rotations import rotation_from_vector
from workers.geometry.transforms import RigidTransform, from_document, to_document

number = st.floats(-3.0, 3.0)
triple = st.tuples(number, number, number)


@st.composite
def transforms(draw, to_frame="a", from_frame="b"):
    return RigidTransform(to_frame, from_frame, rotation_from_vector(draw(triple)), np.array(draw(triple)))


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
    T = RigidTransform.identity("camera", "velodyne")
    with pytest.raises(GeometryError, match="cannot follow") as caught:
        T @ T
    assert caught.value.code == "frames_do_not_meet"


def test_values_are_read_only():
    T = RigidTransform.identity("camera", "velodyne")
    with pytest.raises(ValueError, match="read-only"):
        T.t[0] = 1.0


@pytest.mark.parametrize(
    "broken",
    [
        {},
        {"to_frame": "a", "from_frame": "b"},
        {"to_frame": "a", "from_frame": "b", "rotation": {"angles_deg": [0, 0, 0]}},
        {"to_frame": "a", "from_frame": "b", "rotation": {"matrix": "x"}},
        {"to_frame": "", "from_frame": "b", "rotation": {"quaternion_xyzw": [0, 0, 0, 1]}},
        {"to_frame": "a", "from_frame": "b", "rotation": {"quaternion_xyzw": [0, 0, 0, 0]}},
        {"to_frame": "a", "from_frame": "b", "rotation": {"quaternion_xyzw": [0, 0, 0, 1]}, "translation_m": [1]},
    ],
)
def test_broken_documents_are_refused_with_words(broken):
    with pytest.raises(GeometryError) as caught:
        from_document(broken)
    assert caught.value.message
