"""Locks: one person's writes come one after the other, and so do hand-outs of a recording and what reopens vertices.

Whoever takes both takes the person's first, and the recording's before any row that refers to it. On SQLite every
writing transaction is alone anyway.
"""

from __future__ import annotations

from datetime import datetime
from uuid import UUID

from sqlalchemy import bindparam, select
from sqlalchemy.orm import Session

from service.platform.db.clock import now
from service.platform.db.people import Person
from service.platform.db.recordings import Recording

# Built once: to build a statement takes half as long as to execute it.
_PERSON = (
    select(now())
    .select_from(Person)
    .where(Person.id == bindparam("person"))
    .with_for_update(key_share=True, of=Person)
)
_MARKS_WANTED = select(Recording.marks_per_vertex).where(Recording.id == bindparam("recording"))
_RECORDING, _SHARED = _MARKS_WANTED.with_for_update(key_share=True), _MARKS_WANTED.with_for_update(read=True)


def lock_person(session: Session, person_id: UUID) -> datetime:
    """Lock a person's marking until the transaction ends; returns the time by the database's clock."""
    return session.connection().scalars(_PERSON, {"person": person_id}).one()


def lock_recording(session: Session, recording_id: UUID, *, shared: bool = False) -> int:
    """Lock a recording's hand-out until the transaction ends; returns how many marks each vertex shall get.

    Rows that refer to the recording may still be inserted. ``shared``: others may hand out of it meanwhile.
    """
    return session.connection().scalars(_SHARED if shared else _RECORDING, {"recording": recording_id}).one()
