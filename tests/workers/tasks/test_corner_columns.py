"""The board's other corners, from the detector through the database to the answers."""

import numpy as np
import pytest

from service.detections.views import vertex_views
from service.platform.db.models import Detection, Sensor, Vertex
from tests.workers.tasks.test_detecting import PAIRING, make_run, recording  # noqa: F401 - fixtures
from workers.tasks import detecting
from workers.vertices.corners import move_corners
from workers.vertices.vertex import Corners, Detections
from workers.vertices.vertex import Vertex as Found

OFFSETS = np.array([[0.0, 0.4, -0.4], [0.0, -0.4, -0.4]])


def walked(count=5):
    """Vertices of a walk to the left at 1 m/s, each with two corners that err mostly together."""
    root = np.random.default_rng(3).normal(size=(9, 9)) * 2e-4 + 1e-3 * np.eye(9)
    joint = root @ root.T
    own = tuple(tuple(line) for line in joint[:3, :3].tolist())
    vertices = []
    for sweep in range(count):
        place = np.array([5.0, 0.1 * sweep, 0.5])
        corners = Corners.of(("left", "right"), place + OFFSETS, joint)
        time_ns = 100_000_000 * sweep
        vertices.append(Found(tuple(place), time_ns, 7, sweep, 9, "refined", covariance=own, corners=corners))
    return vertices, joint


def test_corners_are_kept_with_what_they_share_and_move_with_their_vertex(database, make_run):  # noqa: F811
    run = make_run()
    vertices, joint = walked()
    found = Detections(vertices, len(vertices), {})
    stamps = np.array([vertex.time_ns + 20_000_000 for vertex in vertices])
    pairs = detecting._pair(found, stamps, PAIRING | {"mode": "interpolate"}, {})
    run.finish(0, found, pairs)
    with database.reading() as session:
        rows = session.query(Vertex).filter_by(detection_id=run.row.id).order_by(Vertex.sweep_index).all()
        assert [row.corner for row in rows] == ["top"] * 5
        views = vertex_views(session, rows, session.get_one(Sensor, run.camera_id), joint=True)
        assert vertex_views(session, rows, None)[0].joint_covariance is None
        assert session.get_one(Detection, run.row.id).counts["accepted"] == 5
    view = views[2]
    assert [corner.corner for corner in view.corners] == ["left", "right"]
    np.testing.assert_allclose([[one.x, one.y, one.z] for one in view.corners], vertices[2].corners.xyz)
    np.testing.assert_allclose(view.joint_covariance, joint, rtol=1e-8)
    np.testing.assert_allclose(view.corners[1].covariance, joint[6:, 6:], rtol=1e-8)
    (frame,) = view.frames.values()
    expected = move_corners(vertices[2], np.array(pairs[2].xyz), np.array(pairs[2].covariance))
    for told, corner in zip(frame.corners, expected, strict=True):
        assert told.corner == corner.name
        np.testing.assert_allclose([told.x, told.y, told.z], corner.xyz)
        np.testing.assert_allclose(told.covariance, corner.covariance, rtol=1e-8)
        assert told.y - view.frames["front"].moved.y == pytest.approx({"left": 0.4, "right": -0.4}[corner.name])


def test_a_vertex_without_corners_says_so(database, make_run):  # noqa: F811
    run = make_run()
    found = Detections([Found((5.0, 0.0, 0.5), 0, 7, 0, 2, "tolerant")], 1, {})
    run.finish(0, found, [detecting.Pair(0, 0)])
    with database.reading() as session:
        rows = session.query(Vertex).filter_by(detection_id=run.row.id).all()
        (view,) = vertex_views(session, rows, None, joint=True)
    assert (view.corner, view.corners, view.joint_covariance) == ("top", [], None)
    assert view.frames["front"].corners == []
