"""Blobs by row: what may become stored."""

import pytest
from sqlalchemy import update

from service.platform.db.recordings import Blob
from service.platform.db.session import Database
from service.platform.storage.blobs import condemn, forget, keep, reserve
from service.platform.storage.errors import ReservationEndedError


def state_of(database: Database, key: str) -> str | None:
    with database.reading() as session:
        blob = session.get(Blob, key)
        return blob.state if blob else None


def test_what_is_reserved_is_kept_once(database: Database) -> None:
    with database.writing() as session:
        key = reserve(session, "recordings/r/sensors", suffix=".tar")
        keep(session, key, size=3, sha256="0" * 64)
    with database.reading() as session:
        blob = session.get_one(Blob, key)
        assert (blob.state, blob.size, blob.sha256) == ("stored", 3, "0" * 64)
    with pytest.raises(ReservationEndedError), database.writing() as session:
        keep(session, key, size=4)
    assert state_of(database, key) == "stored"


def test_what_was_condemned_meanwhile_is_not_kept(database: Database) -> None:
    with database.writing() as session:
        key = reserve(session, "recordings/r/parts/1")
    with database.writing() as session:
        condemn(session, [key])
    with pytest.raises(ReservationEndedError, match=key), database.writing() as session:
        session.execute(update(Blob).values(size=7))
        keep(session, key, size=3)
    with database.reading() as session:
        blob = session.get_one(Blob, key)
        assert (blob.state, blob.size) == ("condemned", 0), "the caller's transaction has done nothing"
    with database.writing() as session:
        forget(session, [key])
    with pytest.raises(ReservationEndedError), database.writing() as session:
        keep(session, key, size=3)
    assert state_of(database, key) is None
