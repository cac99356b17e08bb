"""A fleet's use of its quota: the sum over its recordings and reports, which cannot drift, and the bytes of its rows.

A recording takes what was announced or has come of its file, and the files of its sensors. What pairs, rigs, answers
and kept replies take of the database is a sum that the upkeep counts, and that what brings many rows adds to. Whoever
takes more locks the fleet's row until the commit, so that many at once do not exceed the quota together.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any, NamedTuple
from uuid import UUID

from sqlalchemy import Select, Text, cast, func, select, update
from sqlalchemy.orm import InstrumentedAttribute, Session

from service.platform.db.analyses import Analysis, AnalysisFile
from service.platform.db.annotations import Answer
from service.platform.db.calibrations import CorrespondenceSet
from service.platform.db.fleets import Fleet, Rig, RigCamera
from service.platform.db.people import IdempotencyKey
from service.platform.db.recordings import Blob, Recording, Sensor, UploadPart
from service.platform.db.rounds import one_by_one
from service.platform.db.session import Database

_UNITS = ("B", "kB", "MB", "GB", "TB", "PB", "EB")


# Bytes of the database with indexes, as PostgreSQL 15 has them: 100,000 pairs, and a hundred thousand of the others.
STORED_PAIR_BYTES = 176
_ANSWER_BYTES = 550
_RIG_BYTES = _CAMERA_BYTES = 1500
# A kept reply without its body.
_REPLY_BYTES = 400


class Use(NamedTuple):
    """Bytes; ``rows`` is the part of ``taken`` that lies in the database."""

    taken: int
    allowed: int
    rows: int = 0


class QuotaExceededError(Exception):
    """The fleet's recordings and reports would take more than they may."""

    code = "fleet_quota_exceeded"

    def __init__(self, use: Use, bytes_more: int) -> None:
        self.use = use
        self.asked = bytes_more
        self.message = (
            f"The fleet's recordings, reports and rows take {spoken(use.taken)} of the {spoken(use.allowed)} that "
            f"they may, and this would take {spoken(bytes_more)} more."
        )
        self.hint = (
            "Delete recordings and unfinished uploads of the fleet that nobody needs, or ask whoever runs the "
            "service for a larger quota."
        )
        super().__init__(self.message)

    @property
    def fields(self) -> dict[str, Any]:
        """Return the figures of the refusal, for programs."""
        return {"taken_bytes": self.use.taken, "quota_bytes": self.use.allowed, "asked_bytes": self.asked}


def uses(session: Session, fleets: Iterable[Fleet], default: int) -> dict[UUID, Use]:
    """Return the bytes that these fleets take and may take; ``default`` for a fleet without a quota of its own."""
    rows = {fleet.id: fleet.row_bytes for fleet in fleets}
    allowed = {fleet.id: fleet.quota_bytes for fleet in fleets}
    taken = dict(rows)
    of_recordings = select(Recording.fleet_id, func.sum(Recording.taken_bytes)).group_by(Recording.fleet_id)
    # A recording's own bytes include the files of its analyses.
    of_reports = _made(Analysis.fleet_id).where(Analysis.recording_id.is_(None)).group_by(Analysis.fleet_id)
    for owner, statement in ((Recording.fleet_id, of_recordings), (Analysis.fleet_id, of_reports)):
        for id, total in session.execute(statement.where(owner.in_(allowed))):
            taken[id] += int(total or 0)
    return {id: Use(taken[id], default if quota is None else quota, rows[id]) for id, quota in allowed.items()}


def count_rows(database: Database) -> None:
    """Count what each fleet's rows take, each fleet in its own transaction."""
    with database.reading() as session:
        fleets = session.scalars(select(Fleet.id).order_by(Fleet.id)).all()
    one_by_one("fleet", fleets, partial(_count_rows, database))


def _count_rows(database: Database, fleet_id: UUID) -> None:
    with database.reading() as session:
        size = _row_bytes(session, fleet_id)
    with database.writing() as session:
        session.execute(update(Fleet).where(Fleet.id == fleet_id, Fleet.row_bytes != size).values(row_bytes=size))


def take_rows(session: Session, fleet_id: UUID, size: int, default: int) -> None:
    """Let a fleet's rows take ``size`` bytes more. Raises :class:`QuotaExceededError`."""
    require_quota(session, fleet_id, size, default)
    session.execute(update(Fleet).where(Fleet.id == fleet_id).values(row_bytes=Fleet.row_bytes + size))


def _row_bytes(session: Session, fleet_id: UUID) -> int:
    rigs = select(Rig.id).where(Rig.fleet_id == fleet_id)
    recordings = select(Recording.id).where(Recording.fleet_id == fleet_id)
    body = func.coalesce(func.length(cast(IdempotencyKey.body, Text)), 0)
    sums = (
        # A selection names what it leaves out, some bytes each, and has no pairs of its own.
        select(func.sum(STORED_PAIR_BYTES * CorrespondenceSet.count)).where(
            CorrespondenceSet.fleet_id == fleet_id, CorrespondenceSet.whole_id.is_(None)
        ),
        select(_RIG_BYTES * func.count()).where(Rig.fleet_id == fleet_id),
        select(_CAMERA_BYTES * func.count()).where(RigCamera.rig_id.in_(rigs)),
        select(_ANSWER_BYTES * func.count()).where(Answer.recording_id.in_(recordings)),
        select(func.sum(_REPLY_BYTES + body)).where(IdempotencyKey.fleet_id == fleet_id),
    )
    return sum(int(session.scalar(total) or 0) for total in sums)


def take(session: Session, recording: Recording, size: int, default: int) -> None:
    """Let a recording, whose row is new or locked, take ``size`` bytes in all.

    Raises :class:`QuotaExceededError` where it takes more than before and the fleet has no room for that.
    """
    more = size - recording.taken_bytes
    if more <= 0:
        return
    require_quota(session, recording.fleet_id, more, default)
    recording.taken_bytes = size


def require_quota(session: Session, fleet_id: UUID, more: int, default: int) -> None:
    """Lock the fleet's row. Raises :class:`QuotaExceededError` if the fleet has no room for ``more`` bytes."""
    fleet = session.scalars(select(Fleet).where(Fleet.id == fleet_id).with_for_update(key_share=True)).one()
    session.flush()
    use = uses(session, [fleet], default)[fleet.id]
    if use.taken + more > use.allowed:
        raise QuotaExceededError(use, more)


def counted(session: Session, recording: Recording, *, besides: int | None) -> int:
    """Bytes of a recording's file, of the files that its rows name, and of those that jobs are writing.

    Those of the job ``besides`` that are not kept do not count.
    """
    of_sensors = select(func.sum(Blob.size)).join(Sensor, Sensor.blob_key == Blob.key)
    writing = select(func.sum(Blob.size)).where(
        Blob.state == "reserved",
        Blob.job_id.is_not(None),
        Blob.job_id != (besides or 0),
        Blob.key.startswith(f"recordings/{recording.id}/", autoescape=True),
    )
    sums = (
        session.scalar(of_sensors.where(Sensor.recording_id == recording.id)),
        session.scalar(writing),
    )
    size = 0 if recording.layers_gone else recording.size
    return size + copied(session, recording.id) + sum(int(total or 0) for total in sums)


@contextmanager
def recounting(session: Session, recording_id: UUID | None, *, besides: int | None) -> Iterator[None]:
    """Lock a recording, if there is one, before its files change, and count it afterwards."""
    recording = recording_id and session.get(Recording, recording_id, with_for_update=True)
    yield
    if recording is not None:
        session.flush()
        recording.taken_bytes = counted(session, recording, besides=besides)


def copied(session: Session, recording_id: UUID) -> int:
    """Bytes of the files that a recording's analyses made."""
    of_recording = _made(Analysis.recording_id).where(Analysis.recording_id == recording_id)
    return sum(int(total) for _, total in session.execute(of_recording.group_by(Analysis.recording_id)))


def _made(owner: InstrumentedAttribute[Any]) -> Select[Any, Any]:
    """Bytes of the files that analyses made, by their owner."""
    return (
        select(owner, func.sum(Blob.size))
        .select_from(AnalysisFile)
        .join(Blob, AnalysisFile.blob_key == Blob.key)
        .join(Analysis, Analysis.id == AnalysisFile.analysis_id)
    )


def coming(session: Session, recording: Recording) -> int:
    """Bytes of a recording's file that have come or are on their way."""
    parts = select(func.sum(UploadPart.size)).where(UploadPart.recording_id == recording.id)
    reserved = select(func.sum(Blob.size)).where(
        Blob.state == "reserved", Blob.key.startswith(f"recordings/{recording.id}/parts/", autoescape=True)
    )
    return int(session.scalar(parts) or 0) + int(session.scalar(reserved) or 0)


def spoken(size: float) -> str:
    """Bytes for people, as the pages write them."""
    for unit in _UNITS[:-1]:
        if size < 1000:
            return f"{size:.0f} {unit}" if unit == _UNITS[0] or size >= 10 else f"{size:.1f} {unit}"
        size /= 1000
    return f"{size:.1f} {_UNITS[-1]}"
