"""Uploads: parts in any order and any number of times, each with its checksum, nothing half-stored."""

import hashlib
import socket
from concurrent.futures import ThreadPoolExecutor
from urllib.parse import urlsplit

import httpx
import pytest
from sqlalchemy import select, update
from sqlalchemy.exc import OperationalError

from service.platform.db.jobs import Job
from service.platform.db.recordings import Blob, UploadPart
from service.recordings import upload_routes
from service.recordings.upload_actions import finish_part
from tests.support.people import Api
from tests.support.processes import wait_until
from tests.support.uploads import blobs, digest, new_recording, put_part, upload

PARTS = [b"first" * 1000, b"second" * 500, b"tail"]


def test_upload_complete_and_read_back(api: Api, engineer, recording) -> None:
    assert recording["state"] == "uploading" and recording["upload"]["part_bytes"] > 0
    whole = b"".join(PARTS)
    accepted = upload(engineer, recording["id"], PARTS, sha256=hashlib.sha256(whole).hexdigest())
    assert accepted.status_code == 202, accepted.text
    job = accepted.json()["job"]
    assert (job["kind"], job["state"]) == ("ingest", "queued")
    got = engineer.get(f"/recordings/{recording['id']}").json()
    assert (got["state"], got["size"], got["job"]["id"]) == ("queued", len(whole), job["id"])
    original = engineer.get(f"/recordings/{recording['id']}/original")
    assert original.content == whole
    assert original.headers["content-length"] == str(len(whole))
    assert "drive.bag" in original.headers["content-disposition"]
    assert blobs(api) == {"stored": 3}


def test_completing_again_gives_the_same_answer_and_one_job(api: Api, engineer, recording) -> None:
    first = upload(engineer, recording["id"], PARTS)
    again = upload(engineer, recording["id"], PARTS)
    assert (first.status_code, first.json()) == (again.status_code, again.json())
    with api.database.reading() as session:
        assert len(session.scalars(select(Job)).all()) == 1
    other = engineer.post(
        f"/recordings/{recording['id']}/complete", {"parts": 3, "size": sum(map(len, PARTS)), "sha256": "0" * 64}
    )
    assert (other.status_code, other.json()["code"]) == (409, "upload_closed")


def test_a_wrong_checksum_stores_nothing(api: Api, engineer, recording) -> None:
    answer = put_part(engineer, recording["id"], 1, b"right", **{"Content-Digest": digest(b"wrong")})
    assert (answer.status_code, answer.json()["code"]) == (400, "checksum_mismatch")
    assert answer.headers["content-type"] == "application/problem+json"
    assert engineer.get(f"/recordings/{recording['id']}/parts").json()["items"] == []
    assert blobs(api) == {"condemned": 1}


@pytest.mark.parametrize(
    "header", ["", "md5=:AAAA:", "sha-256=:???:", "sha-256=:AAAA:", "sha-256=AAAA", b"sha-256=:\xe9:"]
)
def test_a_part_names_its_checksum(engineer, recording, header: str | bytes) -> None:
    answer = put_part(engineer, recording["id"], 1, b"x", **{"Content-Digest": header})
    assert (answer.status_code, answer.json()["code"]) == (400, "checksum_required")
    assert "Content-Digest" in answer.json()["hint"]


def test_the_same_part_again_is_fine_and_other_bytes_are_not(api: Api, engineer, recording) -> None:
    first = put_part(engineer, recording["id"], 1, b"one")
    assert put_part(engineer, recording["id"], 1, b"one").json() == first.json()
    other = put_part(engineer, recording["id"], 1, b"two")
    assert (other.status_code, other.json()["code"]) == (409, "part_differs")
    lying = put_part(engineer, recording["id"], 1, b"two", **{"Content-Digest": digest(b"one")})
    assert (lying.status_code, lying.json()["code"]) == (400, "checksum_mismatch")
    assert blobs(api) == {"stored": 1}
    upload(engineer, recording["id"], [b"one"])
    assert put_part(engineer, recording["id"], 1, b"one").status_code == 200
    closed = put_part(engineer, recording["id"], 2, b"more")
    assert (closed.status_code, closed.json()["code"]) == (409, "upload_closed")


def test_twins_of_one_part_agree_on_one_object(api: Api, engineer, recording) -> None:
    data = b"twin" * 100_000
    with ThreadPoolExecutor(4) as pool:
        answers = list(pool.map(lambda _: put_part(engineer, recording["id"], 1, data), range(4)))
    assert [answer.status_code for answer in answers] == [200] * 4
    with api.database.reading() as session:
        part = session.scalars(select(UploadPart)).one()
        stored = session.scalars(select(Blob).where(Blob.state == "stored")).one()
    assert part.blob_key == stored.key
    assert set(blobs(api)) <= {"stored", "condemned"}


def test_missing_parts_are_listed(engineer, recording) -> None:
    put_part(engineer, recording["id"], 2, b"two")
    answer = engineer.post(f"/recordings/{recording['id']}/complete", {"parts": 3, "size": 9})
    assert (answer.status_code, answer.json()["code"]) == (409, "parts_missing")
    assert answer.json()["missing"] == [1, 3]
    put_part(engineer, recording["id"], 1, b"one")
    put_part(engineer, recording["id"], 3, b"three")
    answer = engineer.post(f"/recordings/{recording['id']}/complete", {"parts": 3, "size": 12})
    assert (answer.status_code, answer.json()["code"]) == (409, "size_differs")


def test_too_large_and_empty_parts(api: Api, make_api) -> None:
    small = make_api(max_part_bytes=1000)
    fleet = small.fleet("other")
    engineer = small.member(fleet, "engineer")
    recording = new_recording(engineer, fleet)
    known = put_part(engineer, recording["id"], 1, b"x" * 1001)
    assert (known.status_code, known.json()["code"]) == (413, "part_too_large")
    assert blobs(small) == {}

    def chunks():
        for _ in range(50):
            yield b"x" * 100

    path = f"/recordings/{recording['id']}/parts/1"
    streamed = engineer.put(path, content=chunks(), headers={"Content-Digest": digest(b"x" * 5000)})
    assert (streamed.status_code, streamed.json()["code"]) == (413, "part_too_large")
    assert blobs(small) == {"condemned": 1}
    empty = put_part(engineer, recording["id"], 1, b"")
    assert (empty.status_code, empty.json()["code"]) == (400, "empty_part")


def test_too_little_disk_is_said_before_it_hurts(api: Api, make_api) -> None:
    full = make_api(min_free_bytes=2**62)
    fleet = full.fleet("other")
    engineer = full.member(fleet, "engineer")
    recording = new_recording(engineer, fleet)
    answer = put_part(engineer, recording["id"], 1, b"x")
    assert (answer.status_code, answer.json()["code"]) == (507, "disk_full")
    assert blobs(full) == {"condemned": 1}


def test_part_numbers_and_upload_of_a_strange_rig(api: Api, engineer, recording) -> None:
    assert put_part(engineer, recording["id"], 0, b"x").status_code == 422
    body = {"rig_id": recording["id"], "name": "n", "file_name": "f"}
    answer = engineer.post(f"/vehicles/{recording['vehicle_id']}/recordings", body)
    assert (answer.status_code, answer.json()["code"]) == (404, "not_found")


def test_refusals_reach_a_client_that_is_still_sending(served, engineer, recording) -> None:
    _, url = served
    part = f"{url}/v1/recordings/{recording['id']}/parts/1"
    token = {"Authorization": f"Bearer {engineer.token}"}
    data, other = b"a" * 8_000_000, b"b" * 8_000_000
    with httpx.Client(timeout=30) as client:
        assert client.put(part, content=data, headers=token | {"Content-Digest": digest(data)}).status_code == 200
        for headers, status in (
            (token | {"Content-Digest": digest(other)}, 409),
            (token, 400),
            ({"Content-Digest": digest(other)}, 401),
        ):
            assert client.put(part, content=other, headers=headers).status_code == status


def test_a_connection_that_breaks_leaves_nothing(served, engineer, recording) -> None:
    api, url = served
    address = urlsplit(url)
    with socket.create_connection((address.hostname, address.port)) as connection:
        head = [
            f"PUT /v1/recordings/{recording['id']}/parts/1 HTTP/1.1",
            f"Host: {address.netloc}",
            f"Authorization: Bearer {engineer.token}",
            f"Content-Digest: {digest(b'x' * 100_000)}",
            "Content-Length: 100000",
        ]
        connection.sendall("\r\n".join([*head, "", ""]).encode() + b"x" * 50_000)
        wait_until(lambda: blobs(api) == {"reserved": 1}, "the reservation")
    wait_until(lambda: blobs(api) == {"condemned": 1}, "the end of the broken upload")
    assert engineer.get(f"/recordings/{recording['id']}/parts").json()["items"] == []
    assert put_part(engineer, recording["id"], 1, b"x" * 100_000).status_code == 200


def test_a_part_whose_acknowledgement_was_lost_survives(api: Api, engineer, recording, monkeypatch) -> None:
    def lose_the_answer(*given):
        finish_part(*given)
        raise OperationalError("COMMIT", {}, Exception("server closed the connection unexpectedly"))

    with monkeypatch.context() as broken:
        broken.setattr(upload_routes, "finish_part", lose_the_answer)
        assert put_part(engineer, recording["id"], 1, b"one").status_code == 503
    assert blobs(api) == {"stored": 1}
    assert upload(engineer, recording["id"], [b"one"]).status_code == 202
    assert engineer.get(f"/recordings/{recording['id']}/original").content == b"one"


def test_a_part_whose_object_is_condemned_is_taken_anew(api: Api, engineer, recording) -> None:
    put_part(engineer, recording["id"], 1, b"one")
    with api.database.writing() as session:
        session.execute(update(Blob).values(state="condemned"))
    assert put_part(engineer, recording["id"], 1, b"two").json()["code"] == "part_differs"
    assert put_part(engineer, recording["id"], 1, b"one").status_code == 200
    assert blobs(api) == {"condemned": 1, "stored": 1}
    with api.database.reading() as session:
        assert session.get_one(Blob, session.scalars(select(UploadPart.blob_key)).one()).state == "stored"
    upload(engineer, recording["id"], [b"one"])
    with api.database.writing() as session:
        session.execute(update(Blob).values(state="condemned"))
    assert put_part(engineer, recording["id"], 1, b"one").json()["code"] == "upload_closed"
