"""Sweeps over HTTP: byte ranges of packed files, cached for ever, and a refusal before they are packed."""

from uuid import UUID

import pytest
from sqlalchemy import select

from apexcal.documents.sweeps import MEDIA_TYPE
from service.platform.db.models import Blob, PackedSweep, PackedSweeps, Recording, Sensor
from service.recordings.actions import delete_recording
from tests.service.detections.seeding import seed_recording, seed_rig
from tests.support.people import Api

pytestmark = pytest.mark.usefixtures("broker")
SWEEPS = [f"sweep {index}".encode() * (index + 1) for index in range(5)]


def seed_packed(api: Api, fleet_id: UUID) -> tuple[UUID, str]:
    """A recording whose LiDAR's sweeps are packed; its id and the key of the packed file."""
    recording_id, _ = seed_recording(api.database, seed_rig(api.database, fleet_id), len(SWEEPS))
    key = f"recordings/{recording_id}/sweeps/one"
    api.app.state.store.put_bytes(key, b"".join(SWEEPS))
    with api.database.writing() as session:
        session.add(Blob(key=key, state="stored"))
        session.flush()
        lidar = select(Sensor.id).where(Sensor.recording_id == recording_id, Sensor.kind == "lidar")
        sensor_id = session.scalars(lidar).one()
        session.add(PackedSweeps(sensor_id=sensor_id, blob_key=key))
        offset = 0
        for index, data in enumerate(SWEEPS):
            place = {"stamp_ns": index * 100, "points": index, "offset": offset, "length": len(data)}
            session.add(PackedSweep(sensor_id=sensor_id, index=index, **place))
            offset += len(data)
    return recording_id, key


def test_sweeps_are_byte_ranges_and_cached_for_ever(api: Api) -> None:
    fleet = api.fleet()
    viewer = api.member(fleet, "viewer")
    recording_id, _ = seed_packed(api, fleet)
    path = f"/recordings/{recording_id}/sweeps"
    page = viewer.get(path, params={"limit": 2}).json()
    assert page["next"] == "1"
    assert page["items"][1] == {"index": 1, "stamp_ns": 100, "points": 1, "length": len(SWEEPS[1])}
    assert [one["index"] for one in viewer.get(path, params={"from_ns": 100, "to_ns": 300}).json()["items"]] == [
        1,
        2,
        3,
    ]
    for index, data in enumerate(SWEEPS):
        answer = viewer.get(f"{path}/{index}")
        assert (answer.content, answer.headers["content-type"]) == (data, MEDIA_TYPE)
        assert "immutable" in answer.headers["cache-control"] and "private" in answer.headers["cache-control"]
        same = viewer.get(f"{path}/{index}", headers={"If-None-Match": answer.headers["etag"]})
        assert (same.status_code, same.content) == (304, b"")
    assert viewer.get(f"{path}/0").headers["etag"] != answer.headers["etag"]
    assert viewer.get(f"{path}/{len(SWEEPS)}").json()["code"] == "no_such_sweep"
    address = viewer.get(f"{path}/2/address").json()
    assert (address["url"], address["length"], address["media_type"]) == (None, len(SWEEPS[2]), MEDIA_TYPE)
    stranger = api.member(api.fleet(), "admin")
    for what in ("", "/0", "/0/address"):
        assert stranger.get(path + what).status_code == 404


def test_what_is_not_packed_says_how_to_pack_it(api: Api) -> None:
    fleet = api.fleet()
    annotator = api.member(fleet, "annotator")
    recording_id, _ = seed_recording(api.database, seed_rig(api.database, fleet), 3)
    path = f"/recordings/{recording_id}"
    for address in ("/sweeps", "/sweeps/0"):
        refused = annotator.get(path + address)
        assert (refused.status_code, refused.json()["code"]) == (409, "not_packed")
        assert "packing" in refused.json()["hint"]
    with api.database.writing() as session:
        session.get_one(Recording, recording_id).state = "ingesting"
    assert annotator.get(f"{path}/sweeps").json()["code"] == "recording_not_ready"


def test_a_deleted_recording_leaves_no_packed_file(api: Api) -> None:
    recording_id, key = seed_packed(api, api.fleet())
    with api.database.writing() as session:
        delete_recording(session, recording_id, with_published=False)
    with api.database.reading() as session:
        assert session.get_one(Blob, key).state == "condemned"
        assert session.scalars(select(PackedSweep)).all() == []
