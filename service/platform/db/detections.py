"""Detection runs and the vertices that they found."""

from __future__ import annotations

from typing import Any
from uuid import UUID

from sqlalchemy import Index, String, UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column

from apexcal.documents.corners import CORNERS, TOP, CornerName
from service.platform.db.base import Base, Corner, Digest, Json, Name, Nanoseconds, Row, Work, belongs_to, refers_to


class Detection(Work):
    """One run of a detector inside a region of one LiDAR's sweeps.

    Its parts are shards of the sweeps. ``marked_corners`` are the board's corners that people are to mark; null for
    the tip alone.
    """

    recording_id: Mapped[UUID] = belongs_to("recording.id")
    lidar_id: Mapped[UUID] = belongs_to("sensor.id")
    region: Mapped[Json]
    detector: Mapped[Name]
    options: Mapped[Json]
    pairing: Mapped[Json]
    content_hash: Mapped[Digest]
    counts: Mapped[Json] = mapped_column(default=dict)
    marked_corners: Mapped[list[Any] | None]
    created_by: Mapped[UUID | None] = refers_to("person.id")


class Apex(Row):
    """A board's vertex in one sweep of one LiDAR, whichever detection runs found it. Verdicts belong to it.

    ``corner``: which of the board's corners it is.
    """

    __table_args__ = (Index("ix_apex_lidar_id_sweep_index", "lidar_id", "sweep_index"),)

    recording_id: Mapped[UUID] = belongs_to("recording.id")
    lidar_id: Mapped[UUID] = belongs_to("sensor.id", index=False)
    sweep_index: Mapped[int]
    x: Mapped[float]
    y: Mapped[float]
    z: Mapped[float]
    corner: Mapped[Corner]


class Vertex(Row):
    """A corner of the board as one detection run measured it, in metres in the frame of its LiDAR.

    ``rank`` orders the marking: any first part of the order covers the whole recording evenly. The corners of a sweep
    share sweep, time and rank. ``covariance`` is 3 x 3 over azimuth (rad), elevation (rad) and range (m), where the
    detector states one; ``flags`` are names of what the person who confirms should look at. A tip's
    ``corner_covariance`` is the lower triangle, by rows, of the covariance of it and the sweep's other corners.
    """

    __table_args__ = (
        UniqueConstraint("detection_id", "apex_id"),
        # With the corner, so that tips are found without a look at the other corners' rows.
        Index("ix_vertex_detection_id_rank_corner", "detection_id", "rank", "corner"),
    )

    detection_id: Mapped[UUID] = belongs_to("detection.id", index=False)
    lidar_id: Mapped[UUID] = belongs_to("sensor.id")
    apex_id: Mapped[UUID] = belongs_to("apex.id")
    rank: Mapped[int]
    sweep_index: Mapped[int]
    time_ns: Mapped[Nanoseconds]
    x: Mapped[float]
    y: Mapped[float]
    z: Mapped[float]
    ring: Mapped[int]
    points: Mapped[int]
    quality: Mapped[str | None] = mapped_column(String(20))
    flags: Mapped[list[Any]] = mapped_column(default=list)
    covariance: Mapped[list[Any] | None]
    corner: Mapped[Corner]
    # Large, and rarely asked for.
    corner_covariance: Mapped[list[Any] | None] = mapped_column(deferred=True)


class VertexFrame(Base):
    """The camera frame that a vertex is paired with. ``gap_ns`` is frame time minus vertex time.

    Where the pairing interpolates, x, y, z and covariance are the vertex's, moved along its track to the frame's
    time, and the gap is zero.
    """

    __table_args__ = (Index("ix_vertex_frame_sensor_id_frame_index", "sensor_id", "frame_index"),)

    vertex_id: Mapped[UUID] = belongs_to("vertex.id", primary_key=True, index=False)
    sensor_id: Mapped[UUID] = belongs_to("sensor.id", primary_key=True, index=False)
    frame_index: Mapped[int]
    gap_ns: Mapped[Nanoseconds]
    x: Mapped[float | None]
    y: Mapped[float | None]
    z: Mapped[float | None]
    covariance: Mapped[list[Any] | None]


def marked_corners(row: Detection) -> list[CornerName]:
    """The board's corners that people are to mark, in the order of `CORNERS`."""
    return [name for name in CORNERS if name in (row.marked_corners or [TOP])]
