"""A fleet's recordings take no more than they may, whoever asks at the same moment; unfinished uploads end."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest
from sqlalchemy import select, update

from service.platform.db.clock import now
from service.platform.db.models import Fleet
from service.platform.db.recordings import Blob, Recording, UploadPart
from service.platform.storage.quota import STORED_PAIR_BYTES, count_rows
from service.recordings.retention import delete_overdue, expire_uploads
from tests.faults.jobs import pairs
from tests.support.asking import bring_pairs
from tests.support.people import Api
from tests.support.uploads import new_recording, new_vehicle, put_part, upload


@pytest.fixture
def api(make_api) -> Api:
    return make_api(fleet_quota_bytes=10_000, upload_hours=2.0)


@pytest.fixture
def vehicle(engineer, fleet):
    return new_vehicle(engineer, fleet)


def announce(actor, vehicle, size: int | None, **headers: str) -> Any:
    body = {"rig_id": vehicle["rig"], "name": "n", "file_name": "f.bag", "size": size}
    return actor.post(f"/vehicles/{vehicle['vehicle']}/recordings", body, headers=headers)


def taken(engineer, fleet) -> int:
    return engineer.get(f"/fleets/{fleet}").json()["taken_bytes"]


def test_an_upload_that_does_not_fit_is_refused_before_its_first_byte(api: Api, engineer, fleet, vehicle) -> None:
    first = announce(engineer, vehicle, 6_000)
    assert first.status_code == 201 and taken(engineer, fleet) == 6_000
    refused = announce(engineer, vehicle, 4_001)
    assert (refused.status_code, refused.json()["code"]) == (403, "fleet_quota_exceeded")
    said = refused.json()
    assert (said["taken_bytes"], said["quota_bytes"], said["asked_bytes"]) == (6_000, 10_000, 4_001)
    assert "6.0 kB of the 10 kB" in said["detail"] and "Delete" in said["hint"]
    assert announce(engineer, vehicle, 4_000).status_code == 201
    # What is deleted makes room at once; another fleet has its own.
    assert engineer.delete(f"/recordings/{first.json()['id']}").status_code == 204
    assert taken(engineer, fleet) == 4_000
    other = api.fleet("other")
    stranger = api.member(other, "engineer")
    assert announce(stranger, new_vehicle(stranger, other), 10_000).status_code == 201


def test_many_uploads_started_at_once_do_not_pass_the_quota_together(engineer, fleet, vehicle) -> None:
    with ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(lambda _: announce(engineer, vehicle, 3_000).status_code, range(8)))
    assert sorted(answers) == [201] * 3 + [403] * 5
    assert taken(engineer, fleet) == 9_000


def test_parts_of_an_upload_without_a_size_take_their_room_one_by_one(api: Api, engineer, fleet) -> None:
    ids = [new_recording(engineer, fleet, name)["id"] for name in "abcd"]
    with ThreadPoolExecutor(4) as pool:
        answers = list(pool.map(lambda id: put_part(engineer, id, 1, b"x" * 4_000), ids))
    assert sorted(answer.status_code for answer in answers) == [200, 200, 403, 403]
    with api.database.reading() as session:
        assert sum(session.scalars(select(UploadPart.size))) == 8_000
    # The same part again takes nothing more, and nothing is left of what was refused.
    done = next(id for id, answer in zip(ids, answers, strict=True) if answer.status_code == 200)
    assert put_part(engineer, done, 1, b"x" * 4_000).status_code == 200
    with api.database.reading() as session:
        assert session.scalars(select(Blob.state)).all() == ["stored", "stored"]


def test_an_upload_takes_what_it_was_in_the_end(engineer, fleet, vehicle) -> None:
    larger = announce(engineer, vehicle, 9_000).json()
    upload(engineer, larger["id"], [b"x" * 3_000])
    assert taken(engineer, fleet) == 3_000
    smaller = announce(engineer, vehicle, 1_000).json()
    # More than it said: as far as there is room.
    assert put_part(engineer, smaller["id"], 1, b"x" * 5_000).status_code == 200
    assert taken(engineer, fleet) == 8_000
    assert put_part(engineer, smaller["id"], 2, b"x" * 2_001).json()["code"] == "fleet_quota_exceeded"


def test_an_operator_gives_one_fleet_more_and_its_page_says_so(api: Api, engineer, fleet, vehicle) -> None:
    with api.database.writing() as session:
        session.get_one(Fleet, fleet).quota_bytes = 20_000
    assert announce(engineer, vehicle, 20_000).status_code == 201
    (listed,) = engineer.get("/fleets").json()["items"]
    assert (listed["taken_bytes"], listed["quota_bytes"]) == (20_000, 20_000)


def let_uploads_end(api: Api) -> None:
    with api.database.writing() as session:
        session.execute(update(Recording).values(expires_at=now(-1)))


def test_an_upload_that_nobody_goes_on_with_ends_and_says_so(api: Api, engineer, fleet, vehicle) -> None:
    created = announce(engineer, vehicle, 9_000).json()
    path = f"/recordings/{created['id']}"
    assert expire_uploads(api.database) == 0
    before = created["upload"]["expires_at"]
    put_part(engineer, created["id"], 1, b"x" * 4_000)
    assert engineer.get(f"{path}/parts").json()["upload"]["expires_at"] > before
    let_uploads_end(api)
    assert expire_uploads(api.database) == 1 and taken(engineer, fleet) == 0
    with api.database.reading() as session:
        assert session.scalars(select(Blob.state)).all() == ["condemned"]
    shown = engineer.get(path).json()
    assert (shown["state"], shown["problem"]["code"]) == ("failed", "upload_expired")
    for answer in (
        put_part(engineer, created["id"], 2, b"x"),
        engineer.get(f"{path}/parts"),
        engineer.post(f"{path}/complete", {"parts": 1, "size": 4_000}),
        engineer.post(f"{path}/retry"),
    ):
        assert (answer.status_code, answer.json()["code"]) == (410, "upload_expired"), answer.text
        assert "new recording" in answer.json()["hint"]
    # It is told for a week, and goes as recordings go.
    with api.database.writing() as session:
        session.execute(update(Recording).values(retain_until=now(-1)))
    assert delete_overdue(api.database) == 1


def test_a_finished_upload_does_not_end(api: Api, engineer, vehicle) -> None:
    created = announce(engineer, vehicle, None).json()
    upload(engineer, created["id"], [b"x" * 100])
    let_uploads_end(api)
    assert expire_uploads(api.database) == 0


def test_rows_take_of_the_quota_too(api: Api, engineer, fleet, vehicle) -> None:
    """What is imported counts at once; rigs and kept replies when the upkeep has counted."""
    with api.database.writing() as session:
        session.execute(update(Fleet).values(quota_bytes=40 * STORED_PAIR_BYTES + 100))
    bring_pairs(engineer, vehicle["rig"], pairs(40, 1))
    assert engineer.get(f"/fleets/{fleet}").json()["row_bytes"] == taken(engineer, fleet) == 40 * STORED_PAIR_BYTES
    refused = engineer.post(
        f"/rigs/{vehicle['rig']}/correspondence-sets", {"pairs": pairs(40, 2)}, params={"camera": "front"}
    )
    assert (refused.status_code, refused.json()["code"]) == (403, "fleet_quota_exceeded")
    assert announce(engineer, vehicle, 101).status_code == 403
    count_rows(api.database)
    counted = taken(engineer, fleet)
    engineer.post(f"/fleets/{fleet}/vehicles", {"name": "second"}, headers={"Idempotency-Key": "kept"})
    count_rows(api.database)
    assert 40 * STORED_PAIR_BYTES < counted < taken(engineer, fleet)
