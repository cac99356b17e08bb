"""The table of analyses, and that of the files that they make."""

from __future__ import annotations

from uuid import UUID

from sqlalchemy import BigInteger, ForeignKey, Index, String
from sqlalchemy.orm import Mapped, mapped_column

from apexcal.documents.states import WorkState
from service.platform.db.base import Base, Dated, Json, belongs_to


class Analysis(Dated):
    """One question and its answer. ``kind`` is that of ``AnalysisKind``, and its job's.

    ``asked`` holds all that the worker needs besides what the row names; ``result`` is the answer, ``single_pairs``
    its columns with one value for each pair. Lists do not read these. Nothing refers to an analysis, and what is
    asked anew is another row. It is deleted with any of the rows that it names.
    """

    __table_args__ = (
        Index("ix_analysis_recording_id_kind", "recording_id", "kind"),
        Index("ix_analysis_vehicle_id_id", "vehicle_id", "id"),
    )

    fleet_id: Mapped[UUID] = belongs_to("fleet.id")
    vehicle_id: Mapped[UUID] = belongs_to("vehicle.id", index=False)
    recording_id: Mapped[UUID | None] = belongs_to("recording.id", nullable=True, index=False)
    detection_id: Mapped[UUID | None] = belongs_to("detection.id", nullable=True)
    set_id: Mapped[UUID | None] = belongs_to("correspondence_set.id", nullable=True)
    result_id: Mapped[UUID | None] = belongs_to("result.id", nullable=True)
    kind: Mapped[str] = mapped_column(String(20))
    asked: Mapped[Json] = mapped_column(default=dict)
    state: Mapped[str] = mapped_column(String(20), default=WorkState.QUEUED)
    result: Mapped[Json | None]
    single_pairs: Mapped[Json | None] = mapped_column(deferred=True)
    problem: Mapped[Json | None]
    job_id: Mapped[int | None] = mapped_column(BigInteger, index=True)


class AnalysisFile(Base):
    """The file that an analysis made, and its name for whoever takes it."""

    analysis_id: Mapped[UUID] = belongs_to("analysis.id", primary_key=True, index=False)
    blob_key: Mapped[str] = mapped_column(ForeignKey("blob.key"), index=True)
    file_name: Mapped[str] = mapped_column(String(300))
