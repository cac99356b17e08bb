"""Sweeps over HTTP: byte ranges of their LiDAR's file, found by its index, cached for ever."""

from uuid import UUID

import pytest
from sqlalchemy import select

from apexcal.documents.sensor_files import SWEEP_ENTRY, TAIL
from apexcal.documents.sweeps import MEDIA_TYPE
from service.platform.db.models import Blob, Recording, Sensor
from service.recordings import sweep_indexes
from service.recordings.actions import remove_layers
from tests.service.detections.seeding import seed_recording, seed_rig
from tests.support.people import Api

SWEEPS = [f"sweep {index}".encode() * (index + 1) for index in range(5)]


def seed_sweeps(api: Api, fleet_id: UUID) -> tuple[UUID, str]:
    """A recording whose LiDAR's file is there; its id and the file's key."""
    recording_id, _ = seed_recording(api.database, seed_rig(api.database, fleet_id), len(SWEEPS))
    offset, entries = 0, b""
    for index, data in enumerate(SWEEPS):
        entries += SWEEP_ENTRY.pack(index * 100, offset, len(data), index)
        offset += len(data)
    whole = b"".join([*SWEEPS, b"{}", entries, bytes(TAIL.size)])
    with api.database.writing() as session:
        lidar = select(Sensor).where(Sensor.recording_id == recording_id, Sensor.kind == "lidar")
        key = session.scalars(lidar).one().blob_key
        session.get_one(Blob, key).size = len(whole)
    api.app.state.store.put_bytes(key, whole)
    return recording_id, key


# A block of two makes one list of several.
@pytest.mark.parametrize("block", [2, 4096])
def test_sweeps_are_byte_ranges_and_cached_for_ever(api: Api, block: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sweep_indexes, "_BLOCK", block)
    fleet = api.fleet()
    viewer = api.member(fleet, "viewer")
    recording_id, _ = seed_sweeps(api, fleet)
    path = f"/recordings/{recording_id}/sweeps"
    page = viewer.get(path, params={"limit": 2}).json()
    assert page["next"] == "1"
    assert page["items"][1] == {"index": 1, "stamp_ns": 100, "points": 1, "length": len(SWEEPS[1])}
    rest = viewer.get(path, params={"after": page["next"]}).json()
    assert (rest["next"], [sweep["index"] for sweep in rest["items"]]) == (None, [2, 3, 4])
    for span, indices in {
        (100, 300): [1, 2, 3],
        (101, 399): [2, 3],
        (401, 500): [],
        (0, 2**63 - 1): [*range(5)],
    }.items():
        between = viewer.get(path, params={"from_ns": span[0], "to_ns": span[1]}).json()["items"]
        assert [sweep["index"] for sweep in between] == indices
    assert viewer.get(path, params={"after": "-1"}).json()["code"] == "invalid_cursor"
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


def test_what_is_not_read_yet_or_removed_says_so(api: Api) -> None:
    fleet = api.fleet()
    viewer = api.member(fleet, "viewer")
    recording_id, _ = seed_sweeps(api, fleet)
    addresses = [f"/recordings/{recording_id}/sweeps{which}" for which in ("", "/0", "/0/address")]
    with api.database.writing() as session:
        session.get_one(Recording, recording_id).state = "ingesting"
    for address in addresses:
        refused = viewer.get(address)
        assert (refused.status_code, refused.json()["code"]) == (409, "recording_not_ready")
    with api.database.writing() as session:
        row = session.get_one(Recording, recording_id)
        row.state = "ready"
        remove_layers(session, row, 3)
    for address in addresses:
        refused = viewer.get(address)
        assert (refused.status_code, refused.json()["code"]) == (410, "retention_ended")
