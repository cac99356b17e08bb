import math
import operator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from apexcal.documents.regions import OPERATORS, QUANTITIES
from workers.vertices.region import Region

_BOX = {"box": {"min": [2, -3, -1], "max": [7, 4, 1.5], "yaw_deg": 33}}
_COMPARE = dict(zip(OPERATORS, (operator.lt, operator.le, operator.gt, operator.ge), strict=True))


def plain_quantity(name, xyz):
    x, y, z = xyz[:, 0], xyz[:, 1], xyz[:, 2]
    return {
        "x": x,
        "y": y,
        "z": z,
        "range": np.sqrt(x * x + y * y + z * z),
        "azimuth_deg": np.degrees(np.arctan2(y, x)),
        "elevation_deg": np.degrees(np.arctan2(z, np.sqrt(x * x + y * y))),
    }[name]


def plain_box(box, xyz, doubtful):
    """The points turned back by the yaw about the box's middle, then compared axis by axis."""
    low, high = np.array(box["min"], float), np.array(box["max"], float)
    middle = 0.5 * (low + high)
    yaw = math.radians(box.get("yaw_deg", 0.0))
    back = np.array([[math.cos(yaw), math.sin(yaw), 0], [-math.sin(yaw), math.cos(yaw), 0], [0, 0, 1]])
    local = (xyz - middle) @ back.T if yaw else xyz - middle
    half = 0.5 * (high - low)
    doubtful |= (np.abs(np.abs(local) - half) <= 1e-9).any(axis=1)
    return (np.abs(local) <= half).all(axis=1)


def plain_polygon(node, xyz, doubtful):
    """The winding of the corners seen from each point: odd inside."""
    corners = np.array(node["polygon"], float)
    inside = np.zeros(len(xyz), bool)
    for i, (x, y, _) in enumerate(xyz):
        crossings = 0
        for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            side = (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0)
            length = math.hypot(x1 - x0, y1 - y0)
            along = (x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)
            if abs(side) <= 1e-9 * (1 + length) and -1e-9 <= along <= length * length + 1e-9:
                doubtful[i] = True
            if min(y0, y1) <= y < max(y0, y1):
                crossings += (side > 0) == (y1 > y0)
        inside[i] = crossings % 2
    low, high = node.get("z") or (-math.inf, math.inf)
    return inside & (xyz[:, 2] >= low) & (xyz[:, 2] <= high)


def plain_mask(node, xyz, doubtful):
    """The tree read straight off with NumPy; marks points that lie on a leaf's threshold to rounding."""
    if "and" in node:
        return np.logical_and.reduce([plain_mask(child, xyz, doubtful) for child in node["and"]])
    if "or" in node:
        return np.logical_or.reduce([plain_mask(child, xyz, doubtful) for child in node["or"]])
    if "not" in node:
        return ~plain_mask(node["not"], xyz, doubtful)
    if "box" in node:
        return plain_box(node["box"], xyz, doubtful)
    if "polygon" in node:
        return plain_polygon(node, xyz, doubtful)
    with np.errstate(all="ignore"):
        left = plain_quantity(node["quantity"], xyz)
        if "divided_by" in node:
            left = left / plain_quantity(node["divided_by"], xyz)
        if node["quantity"] not in "xyz" or node.get("divided_by", "x") not in "xyz":
            doubtful |= np.abs(left - node["value"]) <= 1e-12 * (1.0 + np.abs(left))
        return _COMPARE[node["op"]](left, node["value"])


numbers = st.one_of(st.integers(-5, 5), st.floats(-200, 200, allow_nan=False))
leaves = st.builds(
    lambda quantity, divisor, op, value: {
        "quantity": quantity,
        "op": op,
        "value": value,
        **({"divided_by": divisor} if divisor else {}),
    },
    st.sampled_from(QUANTITIES),
    st.one_of(st.none(), st.sampled_from(QUANTITIES)),
    st.sampled_from(OPERATORS),
    numbers,
)
metres = st.one_of(st.integers(-5, 5), st.integers(-50, 50).map(lambda tenths: tenths / 10))
boxes = st.builds(
    lambda low, size, yaw: {
        "box": {
            "min": list(low),
            "max": [a + b for a, b in zip(low, size, strict=True)],
            **({"yaw_deg": yaw} if yaw else {}),
        }
    },
    st.tuples(metres, metres, metres),
    st.tuples(*[st.floats(0.1, 30)] * 3),
    st.sampled_from([None, 0, 30, -90.0, 200]),
)
polygons = st.builds(
    lambda corners, z: {"polygon": [list(corner) for corner in corners], **({"z": z} if z else {})},
    st.lists(st.tuples(metres, metres), min_size=3, max_size=8),
    st.sampled_from([None, [-1, 2.5]]),
)
trees = st.recursive(
    st.one_of(leaves, leaves, boxes, polygons),
    lambda nodes: st.one_of(
        st.builds(
            lambda key, children: {key: children},
            st.sampled_from(["and", "or"]),
            st.lists(nodes, min_size=1, max_size=4),
        ),
        nodes.map(lambda child: {"not": child}),
    ),
    max_leaves=12,
)
coordinates = st.one_of(st.integers(-3, 3).map(float), st.floats(-60, 60, width=32))
clouds = st.lists(st.tuples(coordinates, coordinates, coordinates), min_size=1, max_size=20)


@settings(max_examples=200, deadline=None)
@given(trees, clouds)
def test_the_compiled_mask_equals_a_plain_evaluation(tree, cloud):
    xyz = np.array(cloud, np.float64)
    doubtful = np.zeros(len(xyz), bool)
    expected = plain_mask(tree, xyz, doubtful)
    found = Region.from_document(tree).mask(xyz)
    np.testing.assert_array_equal(found[~doubtful], expected[~doubtful])


def test_a_box_turns_to_the_left_about_its_own_axis():
    """A plank 10 m long and 1 m wide at (20, 0): random points hardly ever tell to which side it turned."""
    plank = {"min": [15, -0.5, -1], "max": [25, 0.5, 1], "yaw_deg": 30}
    xyz = np.array([[23.9, 2.25, 0], [16.1, -2.25, 0.9], [23.9, -2.25, 0], [24.5, 0, 0], [23.9, 2.25, 1.1]])
    assert Region.from_document({"box": plank}).mask(xyz).tolist() == [True, True, False, False, False]


def test_null_members_count_as_absent():
    document = {"and": [{**_LEAF, "divided_by": None}, {"polygon": [[0, 0], [9, 0], [9, 9]], "z": None}]}
    region = Region.from_document(document)
    assert region.document == {"and": [_LEAF, {"polygon": [[0, 0], [9, 0], [9, 9]]}]}
    assert region.mask(np.array([[5.0, 1, 99], [-5, 1, 0]])).tolist() == [True, False]


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_point_that_is_not_finite_is_never_inside(bad):
    region = Region.from_document({"quantity": "x", "op": "<", "value": 100})
    xyz = np.array([[bad, 0, 0], [0, bad, 0], [0, 0, bad], [0, 0, 0]], np.float32)
    assert region.mask(xyz).tolist() == [False, False, False, True]


def test_no_points_and_wrong_shape():
    region = Region.from_document({"quantity": "x", "op": "<", "value": 1})
    assert region.mask(np.zeros((0, 3), np.float32)).shape == (0,)
    with pytest.raises(ValueError, match=r"\(N, 3\)"):
        region.mask(np.zeros(3))


_LEAF = {"quantity": "x", "op": ">", "value": 0}


@pytest.mark.parametrize("up", [[0.0, 0.342, 0.94], [0.3, -0.2, 0.8], [0.0, 0.0, -1.0], [0.95, 0.1, 0.2]])
def test_a_region_in_level_axes_holds_what_the_points_turned_into_these_axes_say(up):
    tree = {"and": [{"polygon": [[1, -2], [9, -7], [6, 4], [2, 4]], "z": [-1.2, 0.9]}, {"not": _BOX}]}
    points = np.random.default_rng(4).uniform(-10, 10, (20_000, 3))
    z = np.array(up) / np.linalg.norm(up)
    ahead = np.array([1.0, 0.0, 0.0]) if abs(z[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    y = np.cross(z, ahead) / np.linalg.norm(np.cross(z, ahead))
    turned = np.column_stack([points @ np.cross(y, z), points @ y, points @ z])
    found = Region.from_document({"level": tree, "up": up}).mask(points)
    np.testing.assert_array_equal(found, Region.from_document(tree).mask(turned))
    assert 0 < found.sum() < len(points)
