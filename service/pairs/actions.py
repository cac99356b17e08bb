"""Keeping correspondence sets: one row for one content."""

from __future__ import annotations

from sqlalchemy import select, update
from sqlalchemy.orm import Session

from service.platform.db.base import content_hash
from service.platform.db.calibrations import CorrespondenceSet
from service.platform.db.clock import now
from service.platform.db.fleets import Rig


def keep_set(session: Session, candidate: CorrespondenceSet) -> tuple[CorrespondenceSet, bool]:
    """The stored set of this content, and whether it is new. It is the newest of its camera either way.

    A set's origin is part of its content: deleting a recording deletes its sets, and no set of another recording.
    ``candidate`` has everything but its hash, and of a whole set the counts. The rig's row is locked, so that of two
    who bring the same content at the same moment the second finds the first's.
    """
    session.execute(select(Rig.id).where(Rig.id == candidate.rig_id).with_for_update(key_share=True))
    origin = [str(id) if id else None for id in (candidate.recording_id, candidate.detection_id)]
    pairs: object = [str(candidate.whole_id), candidate.left_out]
    if candidate.pairs is not None:
        pairs = candidate.pairs
        candidate.count, candidate.flagged = len(candidate.pairs["x"]), sum(candidate.pairs.get("flagged") or ())
    candidate.content_hash = content_hash({"pairs": pairs, "origin": origin, "notes": candidate.notes})
    existing = session.scalar(
        select(CorrespondenceSet).where(
            CorrespondenceSet.rig_id == candidate.rig_id,
            CorrespondenceSet.camera == candidate.camera,
            CorrespondenceSet.content_hash == candidate.content_hash,
        )
    )
    if existing is not None:
        # A statement, not the object: its recording may be deleted at this moment, and then nothing is changed.
        of = update(CorrespondenceSet).where(CorrespondenceSet.id == existing.id)
        session.execute(of.values(brought_at=now()), execution_options={"synchronize_session": False})
        return existing, False
    session.add(candidate)
    session.flush()
    return candidate, True
