"""Tables of correspondence sets, calibrations, runs, slots and results."""

from __future__ import annotations

from datetime import datetime
from functools import cached_property
from typing import Any
from uuid import UUID

from sqlalchemy import Index, Select, String, UniqueConstraint, select
from sqlalchemy.orm import Mapped, Session, aliased, mapped_column, object_session

from apexcal.documents.checks import Check, CheckVerdict, later_checks
from apexcal.documents.publications import CURRENT
from apexcal.documents.results import FitResult
from apexcal.documents.summaries import BetweenModels, ModelSummary, Summary
from service.platform.db.base import (
    Base,
    Dated,
    Digest,
    Json,
    Name,
    Work,
    belongs_to,
    partial_index,
    refers_to,
    require_memory,
)

FULL = -1
"""The fold of a fit to all pairs."""


class CorrespondenceSet(Dated):
    """Immutable 3D-2D pairs of one camera.

    ``pairs`` is an object of equally long lists: x y z (metres, LiDAR frame), u v (pixels), and where known
    stamp_ns, group, gap_ns, marks. It may have 16 MB, so it is loaded where it is read. A selection has none: it
    names a whole set and the indices of the pairs that it leaves out. ``brought_at`` is when the same content last
    came again: by it, or else by ``created_at``, sets are newer than others.
    """

    __table_args__ = (
        UniqueConstraint("rig_id", "camera", "content_hash"),
        Index("ix_correspondence_set_rig_id_id", "rig_id", "id"),
        partial_index("ix_correspondence_set_made", "rig_id", "camera", "created_at", where="brought_at IS NULL"),
        partial_index(
            "ix_correspondence_set_brought", "rig_id", "camera", "brought_at", where="brought_at IS NOT NULL"
        ),
    )

    fleet_id: Mapped[UUID] = belongs_to("fleet.id")
    vehicle_id: Mapped[UUID] = belongs_to("vehicle.id")
    rig_id: Mapped[UUID] = belongs_to("rig.id")
    recording_id: Mapped[UUID | None] = belongs_to("recording.id", nullable=True)
    detection_id: Mapped[UUID | None] = belongs_to("detection.id", nullable=True)
    camera: Mapped[Name]
    source: Mapped[str] = mapped_column(String(20))
    content_hash: Mapped[Digest]
    count: Mapped[int]
    pairs: Mapped[Json | None] = mapped_column(deferred=True)
    whole_id: Mapped[UUID | None] = belongs_to("correspondence_set.id", nullable=True)
    left_out: Mapped[list[Any] | None]
    flagged: Mapped[int] = mapped_column(default=0)
    notes: Mapped[list[Any]] = mapped_column(default=list)
    created_by: Mapped[UUID | None] = refers_to("person.id")
    brought_at: Mapped[datetime | None]

    @cached_property
    def columns(self) -> Json:
        """The set's own pairs, or those of the whole set without the ones that are left out."""
        require_memory(self.count)
        if self.whole_id is None:
            return self.pairs or {}
        session = object_session(self)
        assert session is not None
        whole = session.get_one(CorrespondenceSet, self.whole_id)
        indices = self.own_indices(whole.count)
        return {name: [values[i] for i in indices] for name, values in whole.columns.items()}

    def own_indices(self, count: int) -> list[int]:
        """Return the indices of the set's pairs among the ``count`` pairs of the whole set."""
        left_out = set(self.left_out or ())
        return [i for i in range(count) if i not in left_out]


class Calibration(Work):
    """A request: every model on every camera's correspondences. Its parts are runs.

    ``reopened`` counts how often its end was taken back, or awaited anew, for a retry.
    """

    __table_args__ = (
        Index("ix_calibration_vehicle_id_created_at", "vehicle_id", "created_at"),
        Index("ix_calibration_vehicle_id_id", "vehicle_id", "id"),
        partial_index("ix_calibration_done", "vehicle_id", "finished_at", where="state = 'done'"),
    )

    vehicle_id: Mapped[UUID] = belongs_to("vehicle.id", index=False)
    rig_id: Mapped[UUID] = belongs_to("rig.id")
    request: Mapped[Json]
    content_hash: Mapped[Digest]
    publish: Mapped[str] = mapped_column(String(20))
    notes: Mapped[list[Any]] = mapped_column(default=list)
    summary: Mapped[Json | None]
    reopened: Mapped[int] = mapped_column(default=0)
    created_by: Mapped[UUID | None] = refers_to("person.id")

    @property
    def summarised(self) -> Summary:
        """The summary, without cameras until the calibration has ended."""
        return Summary.model_validate(self.summary or {"cameras": {}, "rig": None})


class CalibrationRun(Work):
    """One fit: a model on a camera's pairs, all of them (fold -1) or without the held-out block of a fold.

    ``fit_request`` is the complete document that the solver reads; ``search_state`` is the state of the search after
    ``iteration`` finished iterations. Its parts are the bundles of the running iteration.
    """

    PARENT = "calibration"

    __table_args__ = (
        UniqueConstraint("calibration_id", "camera", "model", "fold"),
        partial_index("ix_calibration_run_unended", "id", where="state IN ('queued', 'running')"),
    )

    calibration_id: Mapped[UUID] = belongs_to("calibration.id", index=False)
    set_id: Mapped[UUID] = belongs_to("correspondence_set.id")
    camera: Mapped[Name]
    model: Mapped[str] = mapped_column(String(20))
    fold: Mapped[int]
    farm: Mapped[str] = mapped_column(String(10))
    slots: Mapped[int]
    bundle: Mapped[int]
    fit_request: Mapped[Json]
    iteration: Mapped[int] = mapped_column(default=0)
    search_state: Mapped[Json | None]


class Slot(Base):
    """The best individual of one GA slot. Written once, by whichever twin finished first."""

    run_id: Mapped[UUID] = belongs_to("calibration_run.id", primary_key=True, index=False)
    iteration: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    slot: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    loss: Mapped[float]
    parameters: Mapped[list[Any]]
    evaluations: Mapped[int]
    seconds: Mapped[float]
    worker: Mapped[Name]


class Result(Dated):
    """The result of a run; ``document`` is the solver's solution, with held-out figures if there are any.

    ``document`` has the checks of the fit, ``checks`` those of its calibration and of other data; ``verdict`` is the
    gravest of both for the mount with its lens. Both are null until the calibration has ended. ``compared_with``: the
    result that was the camera's current one then. ``error_20m_mm``: what to expect 20 m away in the middle of the
    image, one standard deviation. The large columns come last: SQLite reads a row up to the column that it needs.
    """

    fleet_id: Mapped[UUID] = belongs_to("fleet.id")
    calibration_id: Mapped[UUID] = belongs_to("calibration.id")
    run_id: Mapped[UUID] = belongs_to("calibration_run.id", index=False)
    camera: Mapped[Name]
    model: Mapped[str] = mapped_column(String(20))
    fold: Mapped[int]
    verdict: Mapped[CheckVerdict | None] = mapped_column(String(4))
    error_20m_mm: Mapped[float | None]
    compared_with: Mapped[UUID | None]
    document: Mapped[Json]
    checks: Mapped[list[Any] | None]
    __table_args__ = (UniqueConstraint("run_id"),)

    @cached_property
    def fit(self) -> FitResult:
        """The document as its class."""
        return FitResult.model_validate(self.document)

    @property
    def summary(self) -> ModelSummary | None:
        """Return the calibration's summary of its model; None before its end, or if the calibration is gone."""
        session = object_session(self)
        assert session is not None
        calibration = session.get(Calibration, self.calibration_id)
        return calibration and calibration.summarised.model(self.camera, self.model)

    @property
    def spread(self) -> BetweenModels | None:
        """Return its deviations with the spread between models; None if there are no other models."""
        return self.summary and self.summary.between_models if self.fold == FULL else None

    @property
    def published_document(self) -> Json:
        """The document with the deviations, intervals and prediction that are published."""
        spread = self.spread
        return self.document | spread.members() if spread else self.document

    @cached_property
    def published(self) -> FitResult:
        """The published document as its class."""
        return FitResult.model_validate(self.published_document)

    @property
    def stored_checks(self) -> list[Check]:
        """The checks of the fit, of its calibration and of other data; a later one replaces one of its name."""
        later = [Check.model_validate(check) for check in self.checks or ()]
        return later_checks(self.fit.checks, later)


class Publication(Dated):
    """A move of an alias of a vehicle's camera: to which result, or nowhere; by whom, when and why.

    ``number`` counts an alias's moves from 1. The highest number says where the alias leads; no clock decides.
    ``result_id`` is null if the alias leads nowhere. Then it was withdrawn, or its result was deleted: ``led_to``
    keeps the id of a deleted result. No other column ever changes. ``overridden`` has the sentences of
    the checks that the result did not pass when it was published.
    """

    __table_args__ = (Index("uq_publication_number", "vehicle_id", "camera", "alias", "number", unique=True),)

    fleet_id: Mapped[UUID] = belongs_to("fleet.id")
    vehicle_id: Mapped[UUID] = belongs_to("vehicle.id", index=False)
    camera: Mapped[Name]
    alias: Mapped[str] = mapped_column(String(64))
    number: Mapped[int]
    result_id: Mapped[UUID | None] = refers_to("result.id")
    led_to: Mapped[UUID | None]
    published_by: Mapped[UUID | None] = refers_to("person.id")
    reason: Mapped[str | None] = mapped_column(String(500))
    overridden: Mapped[list[Any] | None]


def newest_move(vehicle_id: Any, camera: Any, alias: Any, until: datetime | None = None) -> Select[UUID]:
    """A query inside another one for the id of an alias's last move, or of its last until a moment."""
    move = aliased(Publication)
    of_alias = (move.vehicle_id == vehicle_id, move.camera == camera, move.alias == alias)
    in_time = () if until is None else (move.created_at <= until,)
    return select(move.id).where(*of_alias, *in_time).order_by(move.number.desc()).limit(1)


def newest_publication(session: Session, vehicle_id: UUID, camera: str, alias: str = CURRENT) -> Publication | None:
    """The last move of an alias, also one to nowhere; None before the first."""
    return session.scalar(moves_of(vehicle_id, camera, alias).limit(1))


def current_publication(session: Session, vehicle_id: UUID, camera: str, alias: str = CURRENT) -> Publication | None:
    """The move by which an alias leads to a result now; None where it leads nowhere."""
    newest = newest_publication(session, vehicle_id, camera, alias)
    return newest if newest is not None and newest.result_id is not None else None


def moves_of(vehicle_id: UUID, camera: str, alias: str) -> Select[Publication]:
    """A query for an alias's moves, the newest first."""
    of_alias = (Publication.vehicle_id == vehicle_id, Publication.camera == camera, Publication.alias == alias)
    return select(Publication).where(*of_alias).order_by(Publication.number.desc())
