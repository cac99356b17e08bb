"""Parts and frames that go straight between the client and the store."""

import hashlib
from collections.abc import AsyncIterator, Callable
from datetime import datetime, timedelta
from typing import Any

import httpx
import pytest
from sqlalchemy import select, update

from service.admin.backup import back_up
from service.platform.db.clock import utc_now
from service.platform.db.recordings import Blob, Recording, UploadPart
from service.platform.jobs.reaper import reap
from service.platform.storage.audit import audit
from service.platform.storage.store import Store
from tests.service.recordings.test_routes import add_camera
from tests.support.people import Api
from tests.support.processes import wait_until
from tests.support.s3 import S3Server
from tests.support.uploads import blobs, new_recording, put_part, upload

# A fleet's service: what differs between the databases is tested with the folder's parts.
pytestmark = pytest.mark.parametrize("database_url", ["postgresql"], indirect=True)

PARTS = [b"first" * 1000, b"second" * 500, b"tail"]


@pytest.fixture
def api(make_api: Callable[..., Api], on_s3: dict[str, Any]) -> Api:
    return make_api(**on_s3, downloads="presigned")


def announce(engineer, recording, number: int, data: bytes, **changed: object) -> Any:
    body = {"size": len(data), "sha256": hashlib.sha256(data).hexdigest(), **changed}
    return engineer.post(f"/recordings/{recording['id']}/parts/{number}/address", body)


def arrive(engineer, recording, number: int, reservation: str) -> Any:
    body = {"reservation": reservation}
    return engineer.post(f"/recordings/{recording['id']}/parts/{number}/arrival", body)


def put(engineer, recording, number: int, data: bytes) -> dict[str, Any]:
    address = announce(engineer, recording, number, data).json()
    assert httpx.put(address["url"], content=data).status_code == 200
    arrived = arrive(engineer, recording, number, address["reservation"])
    assert arrived.status_code == 200, arrived.text
    return address


def test_parts_go_to_the_store_and_the_original_comes_from_it(api: Api, engineer, recording) -> None:
    assert recording["upload"]["parts"] == "presigned"
    for number, data in enumerate(PARTS, 1):
        put(engineer, recording, number, data)
    path = f"/recordings/{recording['id']}"
    assert [part["number"] for part in engineer.get(f"{path}/parts").json()["items"]] == [1, 2, 3]
    whole = b"".join(PARTS)
    declared = {"parts": 3, "size": len(whole), "sha256": hashlib.sha256(whole).hexdigest()}
    assert engineer.post(f"{path}/complete", declared).status_code == 202
    assert engineer.get(f"{path}/original").content == whole
    original = engineer.get(f"{path}/original/parts").json()
    assert (original["size"], original["file_name"]) == (len(whole), "drive.bag")
    assert datetime.fromisoformat(original["expires_at"]) > utc_now()
    assert b"".join(httpx.get(part["url"]).content for part in original["parts"]) == whole
    assert blobs(api) == {"stored": 3, "condemned": 3}


def test_an_address_changes_nothing_that_is_acknowledged(api: Api, engineer, recording) -> None:
    address = put(engineer, recording, 1, PARTS[0])
    for late in (b"x" * len(PARTS[0]), b"shorter"):
        assert httpx.put(address["url"], content=late).status_code == 200
        assert arrive(engineer, recording, 1, address["reservation"]).status_code == 200
    store = api.app.state.store
    with api.database.reading() as session:
        part = session.scalars(select(UploadPart)).one()
    assert b"".join(store.stream(part.blob_key)) == PARTS[0]
    reap(api.database, store)
    assert [one.key for one in store.list()] == [part.blob_key] and blobs(api) == {"stored": 1}
    httpx.put(address["url"], content=b"later still").raise_for_status()
    assert arrive(engineer, recording, 1, address["reservation"]).json()["sha256"] == part.sha256
    assert audit(api.database, store, timedelta(seconds=-60), remove=True).removed == 1
    assert [one.key for one in store.list()] == [part.blob_key]


def test_a_part_that_changes_while_it_is_acknowledged_is_refused(api: Api, engineer, recording, monkeypatch) -> None:
    address = announce(engineer, recording, 1, b"12345").json()
    httpx.put(address["url"], content=b"12345").raise_for_status()
    real = Store.copy

    async def disturbed(store: Store, key: str, to: str) -> None:
        httpx.put(address["url"], content=b"123").raise_for_status()
        await real(store, key, to)

    monkeypatch.setattr(Store, "copy", disturbed)
    changed = arrive(engineer, recording, 1, address["reservation"])
    assert (changed.status_code, changed.json()["code"]) == (409, "part_size_differs")
    assert blobs(api) == {"reserved": 1, "condemned": 1}
    monkeypatch.undo()
    httpx.put(address["url"], content=b"12345").raise_for_status()
    assert arrive(engineer, recording, 1, address["reservation"]).status_code == 200


def test_a_reservation_that_ends_while_its_bytes_arrive_is_not_kept(
    api: Api, engineer, recording, monkeypatch
) -> None:
    real = Store.put_stream

    async def slow(store: Store, key: str, chunks: AsyncIterator[bytes]) -> None:
        await real(store, key, chunks)
        with api.database.writing() as session:  # as the sweep does two hours later
            session.execute(update(Blob).values(state="condemned"))

    monkeypatch.setattr(Store, "put_stream", slow)
    late = put_part(engineer, recording["id"], 1, PARTS[0])
    assert (late.status_code, late.json()["code"]) == (409, "reservation_ended")
    assert engineer.get(f"/recordings/{recording['id']}/parts").json()["items"] == []
    monkeypatch.undo()
    assert put_part(engineer, recording["id"], 1, PARTS[0]).status_code == 200
    assert blobs(api) == {"condemned": 1, "stored": 1}


def test_other_bytes_than_announced_are_no_damage_of_the_store(api: Api, engineer, recording, tmp_path) -> None:
    """An upload that is wrong is its sender's; a recording that was read once had the right bytes."""
    address = announce(engineer, recording, 1, b"12345").json()
    httpx.put(address["url"], content=b"54321").raise_for_status()
    assert arrive(engineer, recording, 1, address["reservation"]).status_code == 200
    for state in ("uploading", "queued", "ingesting", "failed", "ready"):
        with api.database.writing() as session:
            session.execute(update(Recording).values(state=state))
        made = back_up(api.database, api.app.state.store, tmp_path / state)
        assert made.blobs == 1, "it is backed up as it is"
        assert [one.what[:9] for one in made.damaged] == (["not the b"] if state == "ready" else []), state


def test_an_acknowledged_part_needs_no_address(engineer, recording) -> None:
    first = put(engineer, recording, 1, PARTS[0])
    again = announce(engineer, recording, 1, PARTS[0]).json()
    assert again["url"] is None and again["part"]["sha256"] == hashlib.sha256(PARTS[0]).hexdigest()
    assert arrive(engineer, recording, 1, first["reservation"]).json() == again["part"]
    other = announce(engineer, recording, 1, PARTS[1])
    assert (other.status_code, other.json()["code"]) == (409, "part_differs")
    # Both ways lead to the same parts.
    assert put_part(engineer, recording["id"], 1, PARTS[0]).json() == again["part"]


def test_a_part_counts_only_once_it_is_there_and_whole(api: Api, engineer, recording) -> None:
    address = announce(engineer, recording, 1, b"12345").json()
    early = arrive(engineer, recording, 1, address["reservation"])
    assert (early.status_code, early.json()["code"]) == (409, "part_not_put")
    httpx.put(address["url"], content=b"123").raise_for_status()
    short = arrive(engineer, recording, 1, address["reservation"])
    assert (short.status_code, short.json()["code"]) == (409, "part_size_differs")
    assert engineer.get(f"/recordings/{recording['id']}/parts").json()["items"] == []
    httpx.put(address["url"], content=b"12345").raise_for_status()
    assert arrive(engineer, recording, 1, address["reservation"]).status_code == 200
    assert blobs(api) == {"stored": 1, "condemned": 1}


def test_more_than_was_announced_is_refused_and_removed(api: Api, engineer, fleet, recording) -> None:
    """By an S3 server that does not look at what is signed. What is announced counts to the quota."""
    address = announce(engineer, recording, 1, b"1").json()
    assert "content-length" in address["url"]
    httpx.put(address["url"], content=b"1" * 10**6).raise_for_status()
    large = arrive(engineer, recording, 1, address["reservation"])
    assert (large.status_code, large.json()["code"]) == (409, "part_size_differs")
    reap(api.database, api.app.state.store)
    assert list(api.app.state.store.list()) == [] and blobs(api) == {}
    put(engineer, recording, 1, b"1")
    assert engineer.get(f"/fleets/{fleet}").json()["taken_bytes"] == 1


def test_a_reservation_belongs_to_its_part_and_ends(api: Api, engineer, recording) -> None:
    address = announce(engineer, recording, 1, b"12345").json()
    httpx.put(address["url"], content=b"12345").raise_for_status()
    for number, name in ((2, address["reservation"]), (1, "0" * 32)):
        strange = arrive(engineer, recording, number, name)
        assert (strange.status_code, strange.json()["code"]) == (409, "reservation_ended")
    with api.database.writing() as session:
        session.execute(update(Blob).values(state="condemned"))
    late = arrive(engineer, recording, 1, address["reservation"])
    assert (late.status_code, late.json()["code"]) == (409, "reservation_ended")
    put(engineer, recording, 1, b"12345")
    assert blobs(api) == {"condemned": 2, "stored": 1}


def test_of_twins_one_part_is_acknowledged(api: Api, engineer, recording) -> None:
    twins = [announce(engineer, recording, 1, b"12345").json() for _ in range(2)]
    for twin in twins:
        httpx.put(twin["url"], content=b"12345").raise_for_status()
    answers = [arrive(engineer, recording, 1, twin["reservation"]) for twin in twins]
    assert answers[0].json() == answers[1].json()
    assert blobs(api) == {"condemned": 2, "stored": 1}
    with api.database.reading() as session:
        assert session.scalars(select(UploadPart.blob_key)).one().endswith(twins[0]["reservation"])


def test_what_is_asked_for_is_looked_at(make_api, on_s3, engineer, recording) -> None:
    large = announce(engineer, recording, 1, b"1", size=2**40)
    assert (large.status_code, large.json()["code"]) == (413, "part_too_large")
    assert announce(engineer, recording, 1, b"1", sha256="zz").status_code == 422
    assert announce(engineer, recording, 1, b"1", size=0).status_code == 422
    upload(engineer, recording["id"], [b"12345"])
    closed = announce(engineer, recording, 2, b"1")
    assert (closed.status_code, closed.json()["code"]) == (409, "upload_closed")
    through = make_api(**on_s3, uploads="api")
    fleet = through.fleet("through")
    uploader = through.member(fleet, "engineer")
    waiting = new_recording(uploader, fleet, "waiting")
    assert waiting["upload"]["parts"] == "api"
    refused = announce(uploader, waiting, 1, b"1")
    assert (refused.status_code, refused.json()["code"]) == (409, "parts_through_api")


def test_a_frame_is_a_range_of_the_store(api: Api, engineer, recording) -> None:
    images = [f"image {index}".encode() * 50 for index in range(3)]
    add_camera(api, recording, images)
    path = f"/recordings/{recording['id']}/cameras/front/frames"
    for index, image in enumerate(images):
        address = engineer.get(f"{path}/{index}/address").json()
        last = address["offset"] + address["length"] - 1
        answer = httpx.get(address["url"], headers={"Range": f"bytes={address['offset']}-{last}"})
        assert (answer.status_code, answer.content) == (206, image) and address["media_type"] == "image/jpeg"
        assert engineer.get(f"{path}/{index}").content == image
    assert engineer.get(f"{path}/3/address").json()["code"] == "no_such_frame"


def test_an_object_that_is_gone_is_said_to_be(api: Api, engineer, recording) -> None:
    add_camera(api, recording, [b"image"])
    path = f"/recordings/{recording['id']}"
    with api.database.reading() as session:
        key = session.scalars(select(Blob.key)).one()
    api.app.state.store.delete(key)
    lost = engineer.get(f"{path}/cameras/front/frames/0")
    assert (lost.status_code, lost.json()["code"]) == (410, "blob_missing") and key in lost.json()["hint"]


def test_a_store_that_is_away_is_said_to_be(make_api, engineer, recording, on_s3, s3_server: S3Server) -> None:
    api = make_api(**on_s3, store_timeout_s=0.5)
    address = announce(engineer, recording, 1, b"12345").json()
    upload(engineer, new_recording(engineer, recording["fleet_id"], "other")["id"], [b"x"])
    other = engineer.get("/recordings").json()["items"][0]
    engineer.client = api.client
    s3_server.pause()
    try:
        asked = (
            arrive(engineer, recording, 1, address["reservation"]),
            put_part(engineer, recording["id"], 2, b"x"),
            engineer.get(f"/recordings/{other['id']}/original"),
        )
        assert engineer.get("/recordings").status_code == 200
    finally:
        s3_server.resume()
    for answer in asked:
        assert (answer.status_code, answer.json()["code"]) == (503, "store_unavailable"), answer.text
        assert answer.headers["retry-after"] == "5"
    wait_until(lambda: put_part(engineer, recording["id"], 2, b"x").status_code == 200, "an answer of the store")
