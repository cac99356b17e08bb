"""Correspondence sets: one row for one content, and how the answers show them.

Pairs are shown in parts, from compact columns. A hundred thousand pairs as objects take 70 MB, as JSON 16 MB; as
columns of numbers 6 MB.
"""

from __future__ import annotations

import hashlib
from array import array
from collections.abc import Iterator, Mapping, Sequence
from typing import Any
from uuid import UUID

from pydantic_core import to_json
from sqlalchemy import select, update
from sqlalchemy.orm import Session

from apexcal.documents.correspondence_sets import SetView
from service.platform.db.base import content_hash
from service.platform.db.calibrations import CorrespondenceSet
from service.platform.db.clock import now
from service.platform.db.fleets import Rig
from service.platform.db.session import Database, Encoded
from service.platform.http.problems import not_found


def set_view(row: CorrespondenceSet) -> SetView:
    """A set without its pairs."""
    return SetView.model_validate(row, from_attributes=True)


_AT_ONCE = 2000

Compact = Mapping[str, Sequence[Any]]


def pairs_of(database: Database, set_id: UUID) -> Compact:
    """A set's columns of pairs. Raises :class:`Problem` 404 where the set is gone."""
    with database.reading() as session:
        row = session.get(CorrespondenceSet, set_id)
        if row is None:
            raise not_found()
        return {name: _compact(values) for name, values in row.columns.items()}


def set_in_pieces(row: CorrespondenceSet, columns: Compact) -> Iterator[bytes]:
    """The JSON of a set with its pairs, in the form in which pairs are imported."""
    head = set_view(row).model_dump_json()
    yield head.removesuffix("}").encode() + b',"pairs":['
    names = list(columns)
    for start in range(0, row.count, _AT_ONCE):
        piece = (values[start : start + _AT_ONCE] for values in columns.values())
        pairs = [dict(zip(names, values, strict=True)) for values in zip(*piece, strict=True)]
        yield (b"," if start else b"") + to_json(pairs)[1:-1]
    yield b"]}"


def _compact(values: list[Any]) -> Sequence[Any]:
    # No value changes: what is neither all floats nor all integers of 64 bits stays as it is.
    kinds = set(map(type, values))
    try:
        return array("d", values) if kinds == {float} else array("q", values) if kinds == {int} else values
    except OverflowError:
        return values


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
        encoded = candidate.pairs if isinstance(candidate.pairs, Encoded) else Encoded(candidate.pairs)
        candidate.pairs, pairs = encoded, hashlib.sha256(encoded.text.encode()).hexdigest()
        candidate.count, candidate.flagged = len(encoded["x"]), sum(encoded.get("flagged") or ())
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
        session.execute(of.values(brought_at=now()))
        return existing, False
    session.add(candidate)
    session.flush()
    return candidate, True
