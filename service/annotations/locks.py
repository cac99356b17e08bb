"""What comes one after the other: all that one person writes, and the hand-out of one recording and what reopens it.

Whoever takes both takes the person's first, and the recording's before any row that refers to it. On SQLite every
writing transaction is alone anyway.
"""

from __future__ import annotations

from datetime import datetime
from uuid import UUID

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.db.clock import now
from service.db.people import Person
from service.db.recordings import Recording


def lock_person(session: Session, person_id: UUID) -> datetime:
    """Lock a person's marking until the transaction ends; returns the time by the database's clock."""
    row = select(now()).select_from(Person).where(Person.id == person_id).with_for_update(key_share=True, of=Person)
    return session.scalars(row).one()


def lock_recording(session: Session, recording_id: UUID, *, shared: bool = False) -> int:
    """Lock a recording's hand-out until the transaction ends; returns how many marks each vertex shall get.

    Rows that refer to the recording may still be inserted. ``shared``: others may hand out of it meanwhile.
    """
    row = select(Recording.marks_per_vertex).where(Recording.id == recording_id)
    return session.scalars(row.with_for_update(read=shared, key_share=not shared)).one()
