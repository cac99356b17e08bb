"""A recording with a camera, a detection and its vertices, as rows: what marking and calibrating start from."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from uuid import UUID

from sqlalchemy import inspect, select
from sqlalchemy.orm import Session

from apexcal.documents.corners import TOP
from service.platform.db.annotations import Answer
from service.platform.db.base import Json, new_id
from service.platform.db.detections import Apex, Detection, Vertex, VertexFrame
from service.platform.db.fleets import Fleet, Rig, RigCamera, RigLidar, Vehicle
from service.platform.db.recordings import Blob, CameraFrame, Recording, Sensor
from service.platform.db.session import Database
from tests.support.rows import add, make

SECOND = 10**9


@dataclass(frozen=True)
class Seed:
    """Ids of the seeded rows; vertices in the order of their rank."""

    fleet_id: UUID
    vehicle_id: UUID
    rig_id: UUID
    recording_id: UUID
    camera_id: UUID
    detection_id: UUID
    vertices: list[UUID]
    apexes: list[UUID]


def seed_rig(
    database: Database, fleet_id: UUID, T_vehicle_lidar: dict[str, Any] | None = None, bounds: Any = None
) -> Rig:
    """A vehicle with a rig of one camera, `front`, that looks where the LiDAR does."""
    with database.writing() as session:
        vehicle = add(session, Vehicle, session.get_one(Fleet, fleet_id))
        rig = add(session, Rig, vehicle, lidars=[make(RigLidar, T_vehicle_lidar=T_vehicle_lidar)])
        add(session, RigCamera, rig, bounds=bounds or {})
        return rig


def seed_recording(database: Database, rig: Rig, frames: int, marks_per_vertex: int = 1) -> tuple[UUID, UUID]:
    """A ready recording of 10 Hz with `frames` frames of the camera; returns its id and the camera's."""
    with database.writing() as session:
        recording = add(session, Recording, rig, marks_per_vertex=marks_per_vertex)
        for name, kind in (("lidar", "lidar"), ("front", "camera")):
            blob = add(session, Blob, key=f"{recording.id}/{name}")
            named = {"kind": kind, "name": name, "topic": f"/{name}", "frame_id": name}
            span = {"count": frames, "last_ns": frames * SECOND // 10}
            sensor = add(session, Sensor, recording, blob_key=blob.key, **named, **span)
        session.add_all(make(CameraFrame, sensor, index=n, stamp_ns=n * SECOND // 10) for n in range(frames))
        return recording.id, sensor.id


def seed_detection(database: Database, fleet_id: UUID, recording_id: UUID, apexes: list[UUID]) -> UUID:
    """A finished detection that found a vertex for each apex, in the order of their ranks."""
    with database.writing() as session:
        recording = session.get_one(Recording, recording_id)
        pairing = {"mode": "nearest", "offset_ns": 0, "max_gap_ns": 50_000_000}
        lidar = session.query(Sensor).filter_by(recording_id=recording_id, kind="lidar").one()
        detection = add(session, Detection, recording, lidar, pairing=pairing)
        camera = session.query(Sensor).filter_by(recording_id=recording_id, name="front").one()
        known = {apex.id: apex for apex in session.query(Apex).filter_by(recording_id=recording_id)}
        rows = [vertex_of(detection, known[apex_id], rank) for rank, apex_id in enumerate(apexes)]
        session.add_all(rows)
        session.flush()
        session.add_all(make(VertexFrame, row, camera, frame_index=row.sweep_index, gap_ns=row.rank) for row in rows)
        return detection.id


OFFSETS = {"left": (0.0, 0.4, -0.4), "right": (0.0, -0.4, -0.4), "bottom": (0.0, 0.0, -0.8)}
COVARIANCE = [[1e-6, 0.0, 0.0], [0.0, 4e-6, 0.0], [0.0, 0.0, 1e-4]]
Offsets = Mapping[str, Sequence[float]]


def seed_corners(
    database: Database, detection_id: UUID, offsets_of: Callable[[int], Offsets] = lambda sweep: OFFSETS
) -> None:
    """The other corners of a detection's vertices: `offsets_of` a sweep are metres from its tip."""
    with database.writing() as session:
        for tip in session.query(Vertex).filter_by(detection_id=detection_id, corner=TOP).all():
            tip.covariance = COVARIANCE
            frames = session.query(VertexFrame).filter_by(vertex_id=tip.id).all()
            apex = session.get_one(Apex, tip.apex_id)
            for corner, offset in offsets_of(tip.sweep_index).items():
                there = {"corner": corner, **beside(tip, offset)}
                known = session.query(Apex).filter_by(lidar_id=tip.lidar_id, sweep_index=tip.sweep_index, **there)
                own = known.one_or_none() or copy_of(apex, **there)
                row = copy_of(tip, apex_id=own.id, **there)
                session.add_all([own, row])
                session.flush()
                session.add_all(copy_of(frame, vertex_id=row.id, **beside(frame, offset)) for frame in frames)


def beside(row: Any, offset: Sequence[float]) -> Json:
    """So far from where a row is, if it says where it is."""
    at = (row.x, row.y, row.z)
    return {axis: None if row.x is None else a + b for axis, a, b in zip("xyz", at, offset, strict=True)}


def copy_of(row: Any, **others: Any) -> Any:
    """Another row with these columns, and an id of its own where it has one."""
    values = {column.key: getattr(row, column.key) for column in inspect(type(row)).column_attrs}
    own = {"id": new_id()} if "id" in values else {}
    return type(row)(**values | own | others)


def vertex_of(detection: Detection, apex: Apex, rank: int) -> Vertex:
    where = {"sweep_index": apex.sweep_index, "time_ns": apex.sweep_index * SECOND // 10}
    return make(Vertex, detection, apex, rank=rank, x=apex.x, y=apex.y, z=apex.z, **where)


def seed_apexes(database: Database, recording_id: UUID, count: int) -> list[UUID]:
    """One apex in each of the first sweeps, along a line that leads away from the LiDAR."""
    with database.writing() as session:
        lidar = session.query(Sensor).filter_by(recording_id=recording_id, kind="lidar").one()
        apexes = [make(Apex, lidar, sweep_index=index, x=5.0 + index, y=0.1 * index, z=0.5) for index in range(count)]
        session.add_all(apexes)
        session.flush()
        return [apex.id for apex in apexes]


def vertices_of(database: Database, detection_id: UUID) -> list[UUID]:
    """Ids of a detection's vertices by rank."""
    with database.reading() as session:
        rows = session.query(Vertex).filter_by(detection_id=detection_id).order_by(Vertex.rank)
        return [row.id for row in rows]


def seed_marking(database: Database, fleet_id: UUID, vertices: int = 5, marks_per_vertex: int = 1) -> Seed:
    """All of the above at once."""
    rig = seed_rig(database, fleet_id)
    recording_id, camera_id = seed_recording(database, rig, vertices + 1, marks_per_vertex)
    apexes = seed_apexes(database, recording_id, vertices)
    detection_id = seed_detection(database, fleet_id, recording_id, apexes)
    found = vertices_of(database, detection_id)
    return Seed(fleet_id, rig.vehicle_id, rig.id, recording_id, camera_id, detection_id, found, apexes)


def seed_answer(
    database: Database, seed: Seed, person_id: UUID, number: int, verdict: str, mark: tuple[float, float] | None
) -> None:
    """What a person says of the vertex of this rank, written as a row."""
    with database.writing() as session:
        session.add(
            Answer(
                **answered(seed.recording_id, person_id, seed.camera_id, number, verdict, mark),
                apex_id=seed.apexes[number],
            )
        )


def answered(
    recording_id: UUID,
    person_id: UUID,
    camera_id: UUID,
    frame_index: int,
    verdict: str,
    mark: tuple[float, float] | None,
) -> Json:
    """The columns of a first answer but its apex."""
    u, v = mark or (None, None)
    where = {"recording_id": recording_id, "person_id": person_id, "sensor_id": camera_id, "frame_index": frame_index}
    return where | {"verdict": verdict, "u": u, "v": v, "is_mark": bool(mark), "is_verdict": True}


def standing(session: Session, kind: str) -> list[Answer]:
    """The answers whose mark (``is_mark``) or verdict (``is_verdict``) stands."""
    return [*session.scalars(select(Answer).where(getattr(Answer, kind)).order_by(Answer.created_at))]
