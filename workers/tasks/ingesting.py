"""An upload becomes a recording: parts joined and checked, normalised by a limited child, its frames on record."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, cast
from uuid import UUID

from sqlalchemy import delete, insert, select
from sqlalchemy.orm import Session

from apexcal.documents.states import RecordingState
from service.platform.db.base import Json
from service.platform.db.fleets import Rig, RigCamera
from service.platform.db.recordings import CameraFrame, Recording, Sensor
from service.platform.jobs.claims import Claim, Lease, require_mine
from service.platform.storage.blobs import condemn, keep, reserve, sensor_keys
from service.platform.storage.quota import copied, take
from workers.readers.limited import ingest_limited
from workers.readers.normalised.manifest import SensorManifest
from workers.readers.normalised.sensor_files import FrameFile, SweepFile
from workers.readers.recording import ReadError, legible
from workers.tasks.context import Context
from workers.tasks.originals import join_parts, store_files, watching

_OWN_COLUMNS = {"kind", "name", "topic", "frame_id", "count", "first_ns", "last_ns", "file"}


def ingest(context: Context, claim: Claim, lease: Lease) -> Callable[[Session], Recording]:
    """Normalise the upload into one file per sensor, and store these."""
    with context.database.writing() as session:
        require_mine(session, claim)
        recording = session.get_one(Recording, claim.subject_id)
        recording.state = RecordingState.INGESTING
        rig = session.get_one(Rig, recording.rig_id)
        cameras = session.scalars(
            select(RigCamera).where(RigCamera.rig_id == rig.id).order_by(RigCamera.position)
        ).all()
        image_sizes = {camera.name: (camera.image_width, camera.image_height) for camera in cameras}
        request = _request(recording, rig, cameras)
    with context.scratch() as folder:
        source = join_parts(context, recording, folder, lease)
        out = folder / "normalised"
        terms = watching(context, recording, lease, "reading: {done} messages")
        manifest = ingest_limited(source, out, request, **terms)
        frames = {sensor.name: _frames(out, sensor) for sensor in manifest.sensors}
        for name, size in image_sizes.items():
            _check_sizes(name, size, frames[name])
        files = {sensor.name: out / sensor.file for sensor in manifest.sensors}
        stored = store_files(context, files, lambda sizes: _reserve(context, claim, sizes))

    def write(session: Session) -> Recording:
        _forget_earlier(session, recording)
        row = session.get_one(Recording, recording.id)
        row.taken_bytes = row.size + sum(size for _, size in stored.values()) + copied(session, row.id)
        warnings = [*manifest.warnings, *keep_image_kinds(session, recording.rig_id, manifest.sensors)]
        row.facts, row.warnings = _legible(manifest.facts()), _legible(warnings)
        for sensor in manifest.sensors:
            key, size = stored[sensor.name]
            keep(session, key, size=size)
            sensor_row = _sensor_row(recording, sensor, key)
            session.add(sensor_row)
            session.flush()
            rows = [{"sensor_id": sensor_row.id, **frame} for frame in frames[sensor.name]]
            if rows:
                session.execute(insert(CameraFrame), rows)
        return row

    return write


def _request(recording: Recording, rig: Rig, cameras: Sequence[RigCamera]) -> Json:
    """Return which topic is which sensor: topics named for this recording go before the rig's.

    A rig without cameras gets those that are named, else all that there are.
    """
    options = dict(recording.reading)
    topics: Json = options.pop("topics", {})
    named: Json = topics.get("cameras", {})
    return {
        "lidar": topics.get("lidar") or rig.lidar.topic,
        "cameras": {camera.name: named.get(camera.name) or camera.topic for camera in cameras} or named or None,
        "image_sizes": {camera.name: [camera.image_width, camera.image_height] for camera in cameras},
        "options": options,
    }


def _check_sizes(camera: str, size: tuple[int, int], frames: list[Json]) -> None:
    """Bounds and lens belong to images of the rig's size; others would give a confident wrong answer."""
    for frame in frames:
        if (frame["width"], frame["height"]) != size:
            raise ReadError(
                "image_size_differs",
                f"Frame {frame['index']} of the camera {camera} has {frame['width']} x {frame['height']} pixels, and "
                f"the rig says {size[0]} x {size[1]}.",
                "Was it recorded with another rig, or scaled? Add a rig with the right image_size, give it to the "
                "recording and read it again; or choose the topic of the full images.",
            )


def _reserve(context: Context, claim: Claim, sizes: Mapping[str, int]) -> dict[str, str]:
    """A key for each sensor's file, and what they take of the fleet's quota."""
    with context.database.writing() as session:
        require_mine(session, claim)
        recording = session.get_one(Recording, claim.subject_id, with_for_update=True)
        taken = recording.size + sum(sizes.values()) + copied(session, recording.id)
        take(session, recording, taken, context.settings.fleet_quota_bytes)
        prefix = f"recordings/{recording.id}/sensors"
        return {
            name: reserve(session, prefix, size=size, job_id=claim.job_id, attempt=claim.attempt)
            for name, size in sizes.items()
        }


def _forget_earlier(session: Session, recording: Recording) -> None:
    """Drop what an earlier ingestion of the same upload left."""
    condemn(session, sensor_keys(session, recording.id))
    session.execute(delete(Sensor).where(Sensor.recording_id == recording.id))


def _sensor_row(recording: Recording, sensor: SensorManifest, key: str) -> Sensor:
    return Sensor(
        recording_id=recording.id,
        kind=sensor.kind,
        name=sensor.name,
        topic=_legible(sensor.topic),
        frame_id=_legible(sensor.frame_id),
        blob_key=key,
        count=sensor.count,
        first_ns=sensor.first_ns,
        last_ns=sensor.last_ns,
        facts=_legible(sensor.model_dump(mode="json", exclude=_OWN_COLUMNS)),
    )


def _legible(value: Any) -> Any:
    """Data with every text in it legible: a file may name things with NUL, which PostgreSQL refuses."""
    if isinstance(value, str):
        return legible(value)
    if isinstance(value, Mapping):
        return {_legible(key): _legible(item) for key, item in cast(Mapping[Any, Any], value).items()}
    if isinstance(value, list | tuple):
        return [_legible(item) for item in cast(Sequence[Any], value)]
    return value


def _frames(out: Path, sensor: SensorManifest) -> list[Json]:
    """A camera's frames as rows; a LiDAR has none. The file is looked at before anything leads to it."""
    with (SweepFile if sensor.kind == "lidar" else FrameFile)(out / sensor.file) as file:
        if len(file) != sensor.count:
            raise ValueError(f"{sensor.file} holds {len(file)} of {sensor.count}")
        return list(file.rows()) if isinstance(file, FrameFile) else []


def keep_image_kinds(session: Session, rig_id: UUID, sensors: Sequence[SensorManifest]) -> list[str]:
    """State in the rig what the recording tells of its cameras' images; sentences for the recording's owner."""
    cameras = {camera.name: camera for camera in session.scalars(select(RigCamera).where(RigCamera.rig_id == rig_id))}
    pairs = [(cameras[sensor.name], sensor) for sensor in sensors if sensor.name in cameras]
    for camera, sensor in pairs:
        if camera.images is None and sensor.image_kind is not None:
            R = sensor.camera_info.R if sensor.camera_info and sensor.image_kind == "rectified" else None
            camera.images = {"kind": sensor.image_kind, "rotation": R and {"matrix": [R[:3], R[3:6], R[6:]]}}
            session.get_one(Rig, rig_id).version += 1
    sentences = (_sentence(camera, sensor) for camera, sensor in pairs)
    return [f"{camera.name}: {sentence}" for (camera, _), sentence in zip(pairs, sentences, strict=True) if sentence]


def _sentence(camera: RigCamera, sensor: SensorManifest) -> str | None:
    kind, info, topic = sensor.image_kind, sensor.camera_info, sensor.topic
    stated = camera.images["kind"] if camera.images else None
    if stated is None and info is not None and (info.P or any(info.D)):
        return (
            f"neither the topic {topic} nor its camera info tells whether images are raw or rectified. They are "
            "taken for raw, with the lens K and D. Say in the rig what they are."
        )
    if kind is not None and kind != stated:
        return f"images of {topic} look {kind}, and the rig says {stated}. The rig was followed: is it right?"
    if stated == "rectified":
        return f"images of {topic} are rectified. Their lens is P of the camera info, without distortion."
    return None
