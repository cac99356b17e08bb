"""The board's other corners, from the detector through the database to the answers."""

import numpy as np
import pytest
from sqlalchemy import select

from service.detections.views import vertex_views
from service.platform.db.models import Apex, Detection, Sensor, Vertex, VertexFrame
from tests.workers.tasks.test_detecting import PAIRING, make_run, recording  # noqa: F401 - fixtures
from workers.tasks import detecting
from workers.tasks.vertex_rows import Pair
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
        every = session.query(Vertex).filter_by(detection_id=run.row.id).order_by(Vertex.sweep_index).all()
        assert sorted(row.corner for row in every) == ["left"] * 5 + ["right"] * 5 + ["top"] * 5
        assert len({(row.sweep_index, row.rank, row.time_ns) for row in every}) == 5
        assert sorted({row.rank for row in every}) == [0, 1, 2, 3, 4]
        rows = [row for row in every if row.corner == "top"]
        views = vertex_views(session, rows, session.get_one(Sensor, run.camera_id), joint=True)
        assert vertex_views(session, rows, None)[0].joint_covariance is None
        assert session.get_one(Detection, run.row.id).counts["accepted"] == 5
    view = views[2]
    assert [corner.corner for corner in view.corners] == ["left", "right"]
    np.testing.assert_allclose([[one.x, one.y, one.z] for one in view.corners], vertices[2].corners.xyz)
    np.testing.assert_allclose(view.joint_covariance, joint, rtol=1e-8)
    np.testing.assert_allclose(view.corners[1].covariance, joint[6:, 6:], rtol=1e-8)
    (frame,) = view.frames.values()
    *xyz, covariance = pairs[2].places["top"].values()
    expected = move_corners(vertices[2], np.array(xyz), np.array(covariance))
    for told, corner in zip(frame.corners, expected, strict=True):
        assert told.corner == corner.name
        np.testing.assert_allclose([told.x, told.y, told.z], corner.xyz)
        np.testing.assert_allclose(told.covariance, corner.covariance, rtol=1e-8)
        assert told.y - view.frames["front"].moved.y == pytest.approx({"left": 0.4, "right": -0.4}[corner.name])


def test_a_sweep_that_loses_its_frame_loses_it_for_all_its_corners(database, make_run):  # noqa: F811
    run, other = make_run(), make_run()
    (first, second), _ = walked(2)
    for each in (run, other):
        each.finish(0, Detections([first, second], 2, {}), [Pair(0, 40), Pair(0, -60)])
        assert (each.counts()["paired"], each.counts()["frame_taken"]) == (1, 1)
    with database.reading() as session:
        framed = select(Vertex.sweep_index, Vertex.corner).join(VertexFrame, VertexFrame.vertex_id == Vertex.id)
        for each in (run, other):
            rows = session.execute(framed.where(Vertex.detection_id == each.row.id))
            assert sorted(tuple(row) for row in rows) == [(0, "left"), (0, "right"), (0, "top")]
        assert len(session.scalars(select(Apex)).all()) == 6, "both runs share them"


def test_a_vertex_without_corners_says_so(database, make_run):  # noqa: F811
    run = make_run()
    found = Detections([Found((5.0, 0.0, 0.5), 0, 7, 0, 2, "tolerant")], 1, {})
    run.finish(0, found, [Pair(0, 0)])
    with database.reading() as session:
        rows = session.query(Vertex).filter_by(detection_id=run.row.id).all()
        (view,) = vertex_views(session, rows, None, joint=True)
    assert (view.corner, view.corners, view.joint_covariance) == ("top", [], None)
    assert view.frames["front"].corners == []
