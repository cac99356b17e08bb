"""Vertices of the corners that people are to mark, for a part of a detection's ranks."""

from __future__ import annotations

from collections.abc import Callable

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.detections.corner_vertices import make_corners
from service.platform.db.detections import Detection
from service.platform.db.recordings import Recording
from service.platform.jobs.claims import Claim, Lease
from workers.tasks.context import Context


def corners(context: Context, held: Claim, lease: Lease) -> Callable[[Session], None]:
    """What makes vertices for ranks ``first`` to ``stop`` of the payload, of the corners that are asked for then."""
    ranks = range(held.payload["first"], held.payload["stop"])

    def write(session: Session) -> None:
        recording = select(Detection.recording_id).where(Detection.id == held.subject_id).scalar_subquery()
        lock = select(Recording.id).where(Recording.id == recording).with_for_update(key_share=True)
        if session.execute(lock).one_or_none() is not None:
            make_corners(session, session.get_one(Detection, held.subject_id, populate_existing=True), ranks)

    return write
