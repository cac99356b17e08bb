import math

import numpy as np
import pytest

from workers.vertices.region import Region

_BOX = {"box": {"min": [2, -3, -1], "max": [7, 4, 1.5], "yaw_deg": 33}}


def test_a_box_turns_to_the_left_about_its_own_axis():
    """A plank 10 m long and 1 m wide at (20, 0): random points hardly ever tell to which side it turned."""
    plank = {"min": [15, -0.5, -1], "max": [25, 0.5, 1], "yaw_deg": 30}
    xyz = np.array([[23.9, 2.25, 0], [16.1, -2.25, 0.9], [23.9, -2.25, 0], [24.5, 0, 0], [23.9, 2.25, 1.1]])
    assert Region.from_document({"all": [{"box": plank}]}).mask(xyz).tolist() == [True, True, False, False, False]


def test_null_members_count_as_absent():
    document = {
        "all": [{**_LEAF, "divided_by": None}, {"polygon": [[0, 0], [9, 0], [9, 9]], "z": None}],
        "none": None,
    }
    region = Region.from_document(document)
    assert region.document == {"all": [_LEAF, {"polygon": [[0, 0], [9, 0], [9, 9]]}]}
    assert region.mask(np.array([[5.0, 1, 99], [-5, 1, 0]])).tolist() == [True, False]


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_point_that_is_not_finite_is_never_inside(bad):
    region = Region.from_document({"all": [{"quantity": "x", "op": "<", "value": 100}]})
    xyz = np.array([[bad, 0, 0], [0, bad, 0], [0, 0, bad], [0, 0, 0]], np.float32)
    assert region.mask(xyz).tolist() == [False, False, False, True]


def test_no_points_and_wrong_shape():
    region = Region.from_document({"all": [{"quantity": "x", "op": "<", "value": 1}]})
    assert region.mask(np.zeros((0, 3), np.float32)).shape == (0,)
    with pytest.raises(ValueError, match=r"\(N, 3\)"):
        region.mask(np.zeros(3))


_LEAF = {"quantity": "x", "op": ">", "value": 0}


@pytest.mark.parametrize("up", [[0.0, 0.342, 0.94], [0.3, -0.2, 0.8], [0.0, 0.0, -1.0], [0.95, 0.1, 0.2]])
def test_a_region_in_level_axes_holds_what_the_points_turned_into_these_axes_say(up):
    parts = {"all": [{"polygon": [[1, -2], [9, -7], [6, 4], [2, 4]], "z": [-1.2, 0.9]}], "none": [_BOX]}
    points = np.random.default_rng(4).uniform(-10, 10, (20_000, 3))
    z = np.array(up) / np.linalg.norm(up)
    ahead = np.array([1.0, 0.0, 0.0]) if abs(z[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    y = np.cross(z, ahead) / np.linalg.norm(np.cross(z, ahead))
    turned = np.column_stack([points @ np.cross(y, z), points @ y, points @ z])
    found = Region.from_document({**parts, "up": up}).mask(points)
    np.testing.assert_array_equal(found, Region.from_document(parts).mask(turned))
    assert 0 < found.sum() < len(points)
