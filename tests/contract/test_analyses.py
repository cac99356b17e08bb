"""What the service writes down of an analysis is what the workers answer."""

from dataclasses import fields

import numpy as np

from service.platform.db.annotations import Answer
from service.platform.db.base import new_id
from service.platform.db.detections import Apex, Vertex
from service.platform.db.recordings import Sensor
from tests.service.detections.seeding import SECOND, answered, seed_detection, seed_recording, seed_rig
from tests.support.rows import make
from tests.support.work import work
from workers.solver.clock_offset import OffsetEstimate

OFFSET_S = 0.030
FRAMES = 150
F, CX, CY = 420.0, 325.0, 236.0


def apex_at(seconds):
    """(N, 3) metres: a walk to and fro and from side to side, with the board bobbing."""
    t = np.asarray(seconds, np.float64)
    x = 9.0 + 4.0 * np.sin(0.23 * t)
    return np.column_stack([x, 0.3 * x * np.sin(0.71 * t), 0.4 + 0.1 * x * np.sin(0.57 * t + 1.0)])


def pixels_of(points):
    """(N, 2) where the seeded rig's camera sees them."""
    right, down, forward = -points[:, 1], -points[:, 2] - 0.1, points[:, 0] - 0.2
    return np.column_stack([F * right / forward + CX, F * down / forward + CY])


def seed_walk(database, fleet_id, person_id, *, moving=True, offset_s=OFFSET_S):
    """A detection of a vertex in every sweep, marked in every frame by somebody who is a pixel off."""
    rng = np.random.default_rng(11)
    recording_id, camera_id = seed_recording(database, seed_rig(database, fleet_id), FRAMES)
    seconds = np.arange(FRAMES) / 10 if moving else np.zeros(FRAMES)
    seen = apex_at(seconds) + rng.normal(0.0, 0.004, (FRAMES, 3))
    marks = pixels_of(apex_at(seconds - offset_s * moving)) + rng.normal(0.0, 1.0, (FRAMES, 2))
    with database.writing() as session:
        apexes = [new_id() for _ in range(FRAMES)]
        lidar = session.query(Sensor).filter_by(recording_id=recording_id, kind="lidar").one()
        for index, (apex_id, (x, y, z)) in enumerate(zip(apexes, seen.tolist(), strict=True)):
            session.add(make(Apex, lidar, id=apex_id, sweep_index=index, x=x, y=y, z=z))
        session.flush()
        for index, (apex_id, (u, v)) in enumerate(zip(apexes, marks.tolist(), strict=True)):
            said = answered(recording_id, person_id, camera_id, index, "confirmed", (u, v))
            session.add(Answer(apex_id=apex_id, **said))
    return recording_id, seed_detection(database, fleet_id, recording_id, apexes)


def test_the_offset_between_the_clocks_is_found_from_a_walk_and_its_marks(api, context, fleet, engineer):
    _, detection_id = seed_walk(api.database, fleet, engineer.person_id)
    with api.database.reading() as session:
        assert session.query(Vertex).count() == FRAMES
    asked = engineer.post(
        "/analyses",
        {"kind": "clock_offset", "detection_id": str(detection_id), "camera": "front", "model": "pinhole"},
    )
    assert asked.status_code == 202, asked.text
    work(context)
    done = engineer.get(f"/analyses/{asked.json()['id']}").json()
    assert (done["state"], done["problem"]) == ("done", None)
    assert set(done["result"]) == {field.name for field in fields(OffsetEstimate)}
    off = abs(done["result"]["offset_ns"] / SECOND - OFFSET_S)
    assert off < min(4 * done["result"]["sigma_ns"] / SECOND, 0.008)
    assert str(done["result"]["offset_ns"]) in done["hint"]


def test_who_stands_still_is_told_that_nothing_can_be_told(api, context, fleet, engineer):
    _, detection_id = seed_walk(api.database, fleet, engineer.person_id, moving=False)
    asked = engineer.post(
        "/analyses",
        {"kind": "clock_offset", "detection_id": str(detection_id), "camera": "front", "model": "pinhole"},
    ).json()
    work(context)
    failed = engineer.get(f"/analyses/{asked['id']}").json()
    assert (failed["state"], failed["result"], failed["hint"]) == ("failed", None, None)
    assert failed["problem"]["code"] == "offset_not_determined"
    assert failed["problem"]["detail"] and failed["problem"]["hint"]
