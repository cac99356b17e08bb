"""Tables of what people say of vertices, what was told to whom, marking tasks, and pages of crops."""

from __future__ import annotations

from datetime import datetime
from typing import Any
from uuid import UUID

from sqlalchemy import Index, String, UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column

from service.platform.db.base import Base, Corner, Dated, Version, belongs_to, partial_index


class Answer(Dated):
    """A person's answer on a corner of the board in one frame of one camera. Rows are added, and stay.

    An answer on a task has a ``verdict`` on the apex; with a confirmation ``u`` and ``v``, where (0, 0) is the centre
    of the top-left pixel. Taken back, it is a row without a verdict. A mark that was set without a task has no apex.
    The client makes an answer's ``id``: one that is sent twice is one. ``version`` grows with what the person says
    there. ``reviewed``: something of others' answers had been told to the person before.

    A mark with ``machine_sigma_px`` is the machine's, which the person confirmed on a page of crops: its deviation
    (px per coordinate), and the side of the crop that they saw (``crop_side_px``).

    ``is_mark`` and ``is_verdict`` are what changes: which row's pixel is the person's mark of the corner in the frame
    now, and which row's verdict is theirs on the apex, in all cameras.
    """

    __table_args__ = (
        UniqueConstraint("apex_id", "person_id", "sensor_id", "version"),
        partial_index(
            "uq_answer_mark",
            *("sensor_id", "frame_index", "person_id", "corner"),
            where="IS_TRUE(is_mark)",
            unique=True,
        ),
        partial_index("uq_answer_verdict", "apex_id", "person_id", where="IS_TRUE(is_verdict)", unique=True),
    )

    recording_id: Mapped[UUID] = belongs_to("recording.id")
    person_id: Mapped[UUID] = belongs_to("person.id")
    sensor_id: Mapped[UUID] = belongs_to("sensor.id")
    frame_index: Mapped[int]
    corner: Mapped[Corner]
    apex_id: Mapped[UUID | None] = belongs_to("apex.id", nullable=True, index=False)
    version: Mapped[Version]
    verdict: Mapped[str | None] = mapped_column(String(20))
    u: Mapped[float | None]
    v: Mapped[float | None]
    machine_sigma_px: Mapped[float | None]
    crop_side_px: Mapped[float | None]
    reviewed: Mapped[bool] = mapped_column(insert_default=False)
    is_mark: Mapped[bool] = mapped_column(insert_default=False)
    is_verdict: Mapped[bool] = mapped_column(insert_default=False)


class Disclosure(Base):
    """Something of others' answers on a corner was told to a person: in which frame and sweep, and when first.

    It names what was seen, not the apex of one detection: another detection may pair the frame with another apex.
    """

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


class MarkingTask(Dated):
    """A vertex and camera that a person was given to judge, leased so that nobody gets it twice."""

    __table_args__ = (
        UniqueConstraint("vertex_id", "sensor_id", "person_id"),
        partial_index("ix_marking_task_open", "sensor_id", "leased_until", where="answered_at IS NULL"),
    )

    detection_id: Mapped[UUID] = belongs_to("detection.id")
    vertex_id: Mapped[UUID] = belongs_to("vertex.id", index=False)
    sensor_id: Mapped[UUID] = belongs_to("sensor.id")
    person_id: Mapped[UUID] = belongs_to("person.id")
    leased_until: Mapped[datetime]
    answered_at: Mapped[datetime | None]


class MarkingFrontier(Base):
    """How far a person's marking is in one camera: vertices of lower ranks are not new to them, or closed to them.

    The search for the next one starts here. It holds for ``marks_wanted`` marks of each vertex. Whatever makes a
    vertex take answers again removes the rows of its recording.
    """

    detection_id: Mapped[UUID] = belongs_to("detection.id", primary_key=True, index=False)
    sensor_id: Mapped[UUID] = belongs_to("sensor.id", primary_key=True)
    person_id: Mapped[UUID] = belongs_to("person.id", primary_key=True)
    recording_id: Mapped[UUID] = belongs_to("recording.id")
    marks_wanted: Mapped[int]
    rank: Mapped[int]


class MarkingProgress(Base):
    """Counters of a detection's marking in one camera; its progress is the sum of its rows.

    Each person has a row, so that two who answer never wait for each other. ``mine`` counts the person's vertices.
    ``by_machine`` is set with ``vertices``; whatever changes it removes the rows.
    ``answered`` and ``complete`` are what was counted when ``vertices`` was set, in one of the rows, plus what each
    person's answers changed since. Without a row that has ``vertices``, and ``marks_wanted`` as the recording has it
    now, everything is counted again.
    """

    detection_id: Mapped[UUID] = belongs_to("detection.id", primary_key=True, index=False)
    sensor_id: Mapped[UUID] = belongs_to("sensor.id", primary_key=True)
    person_id: Mapped[UUID] = belongs_to("person.id", primary_key=True)
    vertices: Mapped[int | None]
    marks_wanted: Mapped[int | None]
    by_machine: Mapped[int | None]
    answered: Mapped[int]
    complete: Mapped[int]
    mine: Mapped[int]


class CropPage(Dated):
    """A page of crops with marks of the machine, which a person was given, and what they said of it.

    ``crops`` are in the page's order: ``vertex_id``, the drawn pixel ``u`` and ``v``, the crop's ``side_px``, and
    ``shifted`` where the drawn pixel is not the machine's. ``wrong`` are the vertices whose marks the person rejects.
    The client makes ``answer_id``: an answer that is sent twice is one.
    """

    __table_args__ = (
        partial_index("uq_crop_page_open", "analysis_id", "person_id", where="answered_at IS NULL", unique=True),
    )

    detection_id: Mapped[UUID] = belongs_to("detection.id")
    analysis_id: Mapped[UUID] = belongs_to("analysis.id")
    sensor_id: Mapped[UUID] = belongs_to("sensor.id")
    person_id: Mapped[UUID] = belongs_to("person.id")
    crops: Mapped[list[Any]]
    answer_id: Mapped[UUID | None]
    wrong: Mapped[list[Any] | None]
    answered_at: Mapped[datetime | None]
