"""Keeping correspondence sets: one row for one content."""

from __future__ import annotations

from sqlalchemy import select, update
from sqlalchemy.orm import Session

from service.platform.db.calibrations import CorrespondenceSet
from service.platform.db.clock import now
from service.platform.db.digests import content_hash
from service.platform.db.fleets import Rig


def keep_set(session: Session, wanted: CorrespondenceSet) -> tuple[CorrespondenceSet, bool]:
    """The stored set of this content, and whether it is new. It is the newest of its camera either way.

    A set's origin is part of its content: deleting a recording deletes its sets, and no set of another recording.
    ``wanted`` has everything but its hash, and of a whole set the counts. The rig's row is locked, so that of two who
    bring the same content at the same moment the second finds the first's.
    """
    session.execute(select(Rig.id).where(Rig.id == wanted.rig_id).with_for_update(key_share=True))
    origin = [str(one) if one else None for one in (wanted.recording_id, wanted.detection_id)]
    pairs: object = [str(wanted.whole_id), wanted.left_out]
    if wanted.pairs is not None:
        pairs = wanted.pairs
        wanted.count, wanted.flagged = len(wanted.pairs["x"]), sum(wanted.pairs.get("flagged") or ())
    wanted.content_hash = content_hash({"pairs": pairs, "origin": origin, "notes": wanted.notes})
    known = session.scalar(
        select(CorrespondenceSet).where(
            CorrespondenceSet.rig_id == wanted.rig_id,
            CorrespondenceSet.camera == wanted.camera,
            CorrespondenceSet.content_hash == wanted.content_hash,
        )
    )
    if known is not None:
        # A statement, not the object: its recording may be deleted at this moment, and then nothing is changed.
        of = update(CorrespondenceSet).where(CorrespondenceSet.id == known.id)
        session.execute(of.values(brought_at=now()), execution_options={"synchronize_session": False})
        return known, False
    session.add(wanted)
    session.flush()
    return wanted, True
