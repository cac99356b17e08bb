"""Tables of marks in camera frames, verdicts on vertices, answers and marking tasks."""

from __future__ import annotations

from datetime import datetime
from uuid import UUID

from sqlalchemy import Index, String, UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column

from service.platform.db.base import Base, Corner, Created, Json, RowId, Version, belongs_to, partial_index


class Mark(Base):
    """Where a person sees a corner of the board in one frame of one camera.

    (0, 0) is the centre of the top-left pixel. ``reviewed``: it was placed here after something of others' answers
    had been told to the person.
    """

    __tablename__ = "mark"
    __table_args__ = (
        UniqueConstraint("person_id", "sensor_id", "frame_index", "corner"),
        Index("ix_mark_sensor_id_frame_index", "sensor_id", "frame_index"),
    )

    id: Mapped[RowId]
    recording_id: Mapped[UUID] = belongs_to("recording.id")
    person_id: Mapped[UUID] = belongs_to("person.id", index=False)
    sensor_id: Mapped[UUID] = belongs_to("sensor.id", index=False)
    frame_index: Mapped[int]
    u: Mapped[float]
    v: Mapped[float]
    covariance: Mapped[Json | None]
    corner: Mapped[Corner]
    reviewed: Mapped[bool] = mapped_column(insert_default=False)
    version: Mapped[Version]
    created_at: Mapped[Created]
    updated_at: Mapped[Created]


class Verdict(Base):
    """A person's word on a vertex of a sweep: confirmed, rejected or unsure; ``reviewed`` as for a mark."""

    __tablename__ = "verdict"
    __table_args__ = (UniqueConstraint("apex_id", "person_id"),)

    id: Mapped[RowId]
    recording_id: Mapped[UUID] = belongs_to("recording.id")
    apex_id: Mapped[UUID] = belongs_to("apex.id", index=False)
    person_id: Mapped[UUID] = belongs_to("person.id")
    verdict: Mapped[str] = mapped_column(String(20))
    reviewed: Mapped[bool] = mapped_column(insert_default=False)
    version: Mapped[Version]
    created_at: Mapped[Created]
    updated_at: Mapped[Created]


class AnnotationRevision(Base):
    """Every state that a mark or a verdict has had, so that nothing said is lost by a correction."""

    __tablename__ = "annotation_revision"
    __table_args__ = (UniqueConstraint("subject_id", "version"),)

    id: Mapped[RowId]
    recording_id: Mapped[UUID] = belongs_to("recording.id")
    person_id: Mapped[UUID] = belongs_to("person.id")
    subject: Mapped[str] = mapped_column(String(20))
    subject_id: Mapped[UUID]
    version: Mapped[int]
    value: Mapped[Json]
    created_at: Mapped[Created]


class Answer(Base):
    """An answer of a person on a vertex in one camera, or that they took it back: then it has no verdict.

    The client makes the ``id``: an answer that is sent twice is one. ``version`` counts from 1 for each person, apex
    and camera; the last one says what the person's mark and verdict are. Rows are never changed.
    """

    __tablename__ = "answer"
    __table_args__ = (UniqueConstraint("person_id", "apex_id", "sensor_id", "version"),)

    id: Mapped[RowId]
    recording_id: Mapped[UUID] = belongs_to("recording.id")
    person_id: Mapped[UUID] = belongs_to("person.id", index=False)
    apex_id: Mapped[UUID] = belongs_to("apex.id")
    sensor_id: Mapped[UUID] = belongs_to("sensor.id")
    frame_index: Mapped[int]
    version: Mapped[int]
    verdict: Mapped[str | None] = mapped_column(String(20))
    u: Mapped[float | None]
    v: Mapped[float | None]
    reviewed: Mapped[bool]
    created_at: Mapped[Created]


class Disclosure(Base):
    """Something of others' answers on a corner was told to a person: in which frame and sweep, and when first.

    It names what was seen, not the apex of one detection: another detection may pair the frame with another apex.
    """

    __tablename__ = "disclosure"
    __table_args__ = (
        Index("ix_disclosure_recording_id_person_id_sweep_index", "recording_id", "person_id", "sweep_index"),
    )

    recording_id: Mapped[UUID] = belongs_to("recording.id", index=False)
    person_id: Mapped[UUID] = belongs_to("person.id", primary_key=True, index=False)
    sensor_id: Mapped[UUID] = belongs_to("sensor.id", primary_key=True)
    frame_index: Mapped[int] = mapped_column(primary_key=True)
    sweep_index: Mapped[int] = mapped_column(primary_key=True)
    corner: Mapped[Corner] = mapped_column(primary_key=True)
    told_in: Mapped[str] = mapped_column(String(20))
    told_at: Mapped[datetime]


class MarkingTask(Base):
    """A vertex and camera that a person was given to judge, leased so that nobody gets it twice."""

    __tablename__ = "marking_task"
    __table_args__ = (
        UniqueConstraint("vertex_id", "sensor_id", "person_id"),
        partial_index("ix_marking_task_open", "sensor_id", "leased_until", where="answered_at IS NULL"),
    )

    id: Mapped[RowId]
    detection_id: Mapped[UUID] = belongs_to("detection.id")
    vertex_id: Mapped[UUID] = belongs_to("vertex.id", index=False)
    sensor_id: Mapped[UUID] = belongs_to("sensor.id")
    person_id: Mapped[UUID] = belongs_to("person.id")
    leased_until: Mapped[datetime]
    answered_at: Mapped[datetime | None]
    created_at: Mapped[Created]


class MarkingFrontier(Base):
    """How far a person's marking is in one camera: no vertex of a lower rank is new to them and takes their answer.

    The search for the next one starts here. It holds for ``marks_wanted`` marks of each vertex. Whatever makes a
    vertex take answers again removes the rows of its recording.
    """

    __tablename__ = "marking_frontier"

    detection_id: Mapped[UUID] = belongs_to("detection.id", primary_key=True, index=False)
    sensor_id: Mapped[UUID] = belongs_to("sensor.id", primary_key=True)
    person_id: Mapped[UUID] = belongs_to("person.id", primary_key=True)
    recording_id: Mapped[UUID] = belongs_to("recording.id")
    marks_wanted: Mapped[int]
    rank: Mapped[int]


class MarkingProgress(Base):
    """Counters of a detection's marking in one camera; its progress is the sum of its rows.

    Each person has a row, so that two who answer never wait for each other. ``mine`` counts the person's vertices.
    ``answered`` and ``complete`` are what was counted when ``vertices`` was set, in one of the rows, plus what each
    person's answers changed since. Without a row that has ``vertices``, and ``marks_wanted`` as the recording has it
    now, everything is counted again.
    """

    __tablename__ = "marking_progress"

    detection_id: Mapped[UUID] = belongs_to("detection.id", primary_key=True, index=False)
    sensor_id: Mapped[UUID] = belongs_to("sensor.id", primary_key=True)
    person_id: Mapped[UUID] = belongs_to("person.id", primary_key=True)
    vertices: Mapped[int | None]
    marks_wanted: Mapped[int | None]
    answered: Mapped[int]
    complete: Mapped[int]
    mine: Mapped[int]
