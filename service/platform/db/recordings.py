"""Recordings: their upload, their blobs, their sensors, the byte range of every camera frame."""

from __future__ import annotations

from datetime import datetime
from typing import Any
from uuid import UUID

from sqlalchemy import BigInteger, ForeignKey, Index, String, UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column

from apexcal.documents.states import RecordingState
from service.platform.db.base import (
    Base,
    Bytes,
    Created,
    Dated,
    Digest,
    Json,
    Name,
    Nanoseconds,
    Row,
    Version,
    belongs_to,
    partial_index,
    refers_to,
)


class Blob(Base):
    """One object of the store, reserved here before its first byte is written.

    ``reserved`` may hold bytes or not; ``stored`` is durable and in use; ``condemned`` is removed by the reaper.
    ``job_id`` and ``attempt`` say whose work a reservation is; an upload part's has none. One that the store did not
    remove is tried again after ``remove_after``.
    """

    __table_args__ = (Index("ix_blob_state_created_at", "state", "created_at"),)

    key: Mapped[str] = mapped_column(String(300), primary_key=True)
    state: Mapped[str] = mapped_column(String(20), default="reserved")
    size: Mapped[Bytes] = mapped_column(default=0)
    sha256: Mapped[str | None] = mapped_column(String(64))
    job_id: Mapped[int | None] = mapped_column(BigInteger, index=True)
    attempt: Mapped[int | None]
    failed_removals: Mapped[int] = mapped_column(default=0)
    remove_after: Mapped[datetime | None]
    created_at: Mapped[Created]


class BlobHold(Row):
    """While one is in force no object is removed: a backup copies what its snapshot of the rows names."""

    reason: Mapped[str] = mapped_column(String(100))
    until: Mapped[datetime]


class Recording(Dated):
    """A recording in one of the states uploading, queued, ingesting, ready, failed.

    ``reading`` is what its owner knows of the file and the file does not say. ``taken_bytes`` is what it takes of its
    fleet's quota: what was announced or has come of its file, and its sensors' files. ``expires_at`` ends an upload
    that nobody goes on with. One that must stay past ``retain_until`` is looked at again after ``kept_until``.
    ``layers_gone`` counts those of `LAYERS` that its fleet's retention removed.
    """

    __table_args__ = (
        Index("ix_recording_fleet_id_id", "fleet_id", "id"),
        Index("ix_recording_fleet_id_state_id", "fleet_id", "state", "id"),
        Index("ix_recording_fleet_id_taken_bytes", "fleet_id", "taken_bytes"),
        Index("ix_recording_vehicle_id_id", "vehicle_id", "id"),
        Index("ix_recording_rig_id_state_id", "rig_id", "state", "id"),
        Index("ix_recording_fleet_id_layers_gone_created_at", "fleet_id", "layers_gone", "created_at"),
        partial_index("ix_recording_retain_until", "retain_until", where="retain_until IS NOT NULL"),
    )

    fleet_id: Mapped[UUID] = belongs_to("fleet.id")
    vehicle_id: Mapped[UUID] = belongs_to("vehicle.id")
    rig_id: Mapped[UUID] = belongs_to("rig.id", index=False)
    name: Mapped[Name]
    file_name: Mapped[Name]
    state: Mapped[str] = mapped_column(String(20), default=RecordingState.UPLOADING)
    size: Mapped[Bytes] = mapped_column(default=0)
    sha256: Mapped[str | None] = mapped_column(String(64))
    marks_per_vertex: Mapped[int] = mapped_column(default=1)
    reading: Mapped[Json] = mapped_column(default=dict)
    facts: Mapped[Json | None]
    warnings: Mapped[list[Any]] = mapped_column(default=list)
    problem: Mapped[Json | None]
    job_id: Mapped[int | None] = mapped_column(BigInteger, index=True)
    retain_until: Mapped[datetime | None]
    kept_until: Mapped[datetime | None]
    layers_gone: Mapped[int] = mapped_column(default=0)
    taken_bytes: Mapped[Bytes] = mapped_column(default=0)
    expires_at: Mapped[datetime | None]
    created_by: Mapped[UUID | None] = refers_to("person.id")
    version: Mapped[Version]


# In the order in which retention removes them: the file as it came, the cameras' images, the LiDAR's sweeps.
LAYERS = ("original", "images", "sweeps")


class UploadPart(Base):
    """One acknowledged part of a recording's original file, numbered from 1."""

    recording_id: Mapped[UUID] = belongs_to("recording.id", primary_key=True, index=False)
    number: Mapped[int] = mapped_column(primary_key=True)
    blob_key: Mapped[str] = mapped_column(ForeignKey("blob.key"))
    size: Mapped[Bytes]
    sha256: Mapped[Digest]


class Sensor(Row):
    """One normalised sensor of a recording: a LiDAR named ``lidar`` or a camera with its name in the rig.

    Its file holds ``count`` sweeps or frames and an index of them (`apexcal.documents.sensor_files`).
    """

    __table_args__ = (UniqueConstraint("recording_id", "name"),)

    recording_id: Mapped[UUID] = belongs_to("recording.id")
    kind: Mapped[str] = mapped_column(String(20))
    name: Mapped[Name]
    topic: Mapped[str]
    frame_id: Mapped[str]
    blob_key: Mapped[str] = mapped_column(ForeignKey("blob.key"))
    count: Mapped[int]
    first_ns: Mapped[Nanoseconds]
    last_ns: Mapped[Nanoseconds]
    facts: Mapped[Json]


class CameraFrame(Base):
    """The place of a camera frame's encoded image in its sensor's blob."""

    __table_args__ = (Index("ix_camera_frame_sensor_id_stamp_ns", "sensor_id", "stamp_ns"),)

    sensor_id: Mapped[UUID] = belongs_to("sensor.id", primary_key=True, index=False)
    index: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    stamp_ns: Mapped[Nanoseconds]
    offset: Mapped[Bytes]
    length: Mapped[Bytes]
    media_type: Mapped[str] = mapped_column(String(40))
    width: Mapped[int]
    height: Mapped[int]
