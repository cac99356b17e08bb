"""The reserve of the store's disk holds also while many parts come at once, and while others fill the disk."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AsyncExitStack

import httpx
import pytest
from sqlalchemy import select

from service.platform.db.recordings import UploadPart
from service.platform.storage import disk_reservations
from service.platform.storage.store import Store
from tests.support.databases import one_database
from tests.support.people import Api
from tests.support.uploads import digest, put_part

pytestmark = one_database

MB = 10**6
DISK, RESERVE = 60 * MB, 10 * MB


@pytest.fixture
def api(make_api, monkeypatch) -> Api:
    """A service whose disk has 60 MB, 10 of them its reserve."""
    api: Api = make_api(min_free_bytes=RESERVE, max_part_bytes=30 * MB)
    monkeypatch.setattr(api.app.state.store, "free_bytes", lambda: DISK - used(api.app.state.store))
    return api


def used(store: Store) -> int:
    assert store.folder
    return sum(file.stat().st_size for file in store.folder.rglob("*") if file.is_file())


def test_parts_that_come_at_once_do_not_pass_the_reserve_together(api: Api, engineer, recording) -> None:
    with ThreadPoolExecutor(6) as pool:
        answers = list(
            pool.map(lambda number: put_part(engineer, recording["id"], number, b"x" * 20 * MB), range(1, 7))
        )
    assert {answer.status_code for answer in answers} == {200, 507}
    assert api.app.state.store.free_bytes() >= RESERVE
    refused = next(answer for answer in answers if answer.status_code == 507)
    assert refused.json()["code"] == "disk_full"
    # What was promised to those that are done or refused is given back.
    assert put_part(engineer, recording["id"], 9, b"x" * MB).status_code == 200


def test_a_part_ends_where_another_fills_the_disk_meanwhile(served, engineer, recording) -> None:
    api, url = served
    filler = api.app.state.store.folder / "of somebody else"

    def chunks() -> Iterator[bytes]:
        for number in range(28):
            if number == 2:
                filler.write_bytes(b"x" * 40 * MB)
            yield b"y" * MB

    headers = {"Content-Digest": digest(b"y" * 28 * MB), "Authorization": f"Bearer {engineer.token}"}
    with httpx.Client(timeout=30) as client:
        answer = client.put(f"{url}/v1/recordings/{recording['id']}/parts/1", content=chunks(), headers=headers)
    assert (answer.status_code, answer.json()["code"]) == (507, "disk_full")
    with api.database.reading() as session:
        assert session.scalars(select(UploadPart)).all() == []
    filler.unlink()
    assert put_part(engineer, recording["id"], 1, b"y" * MB).status_code == 200


def test_parts_that_trickle_take_no_room_and_must_find_it_where_they_hurry(api: Api, monkeypatch) -> None:
    """Together they announced three times the disk."""
    monkeypatch.setattr(disk_reservations, "_FIRST_S", 0.0)

    async def in_one_piece(size: int) -> AsyncIterator[bytes]:
        yield b"x" * size

    async def trickle() -> list[int]:
        passed: list[int] = []
        async with AsyncExitStack() as stack:
            parts = [await stack.enter_async_context(api.app.state.disk.reserve(30 * MB)) for _ in range(5)]
            await stack.enter_async_context(api.app.state.disk.reserve(20 * MB))
            for part in parts:
                passed.append(len([chunk async for chunk in part.watch(in_one_piece(20 * MB))]))
                assert (part.lost is None) == bool(passed[-1])
        return passed

    # Nothing is written here, so each that has come takes its room from the next.
    assert asyncio.run(trickle()) == [1, 0, 0, 0, 0]
