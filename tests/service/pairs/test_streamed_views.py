"""A large set costs little memory on its way out, and what a client has already costs none."""

import json
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from uuid import UUID

import httpx
import pytest
from sqlalchemy import event

from service.platform.db.calibrations import CorrespondenceSet
from service.platform.http.limits import ConcurrencyLimiter
from tests.service.detections.seeding import seed_rig
from tests.support.people import Api

COUNT = 40_000
MIB = 1024 * 1024


def seed_set(api: Api, fleet, count: int) -> CorrespondenceSet:
    rig = seed_rig(api.database, fleet)
    row = CorrespondenceSet(fleet_id=fleet, vehicle_id=rig.vehicle_id, rig_id=rig.id, camera="front")
    row.source, row.content_hash, row.count, row.notes = "import", "0", count, ["a note, 3 µm wide"]
    row.flagged = (count + 1) // 2
    numbers = [number + 0.123456789012 for number in range(count)]
    row.pairs = {
        **dict.fromkeys("xyzuv", numbers),
        "stamp_ns": [2**62 + number for number in range(count)],
        "group": [f"Ä {number}" for number in range(count)],
        "flagged": [number % 2 == 0 for number in range(count)],
        "sigma_px": [number if number % 2 else number + 0.5 for number in range(count)],
    }
    with api.database.writing() as session:
        session.add(row)
    return row


def test_a_set_comes_whole_whatever_its_values_are(api: Api) -> None:
    fleet = api.fleet()
    row = seed_set(api, fleet, 4001)
    answer = api.member(fleet, "viewer").get(f"/correspondence-sets/{row.id}")
    assert answer.headers["content-type"] == "application/json" and answer.headers["etag"] == '"0"'
    found = answer.json()
    pairs = [dict(zip(row.pairs, values, strict=True)) for values in zip(*row.pairs.values(), strict=True)]
    assert found["pairs"] == pairs and json.dumps(found["pairs"]) == json.dumps(pairs)
    assert (found["count"], found["flagged"], found["notes"], found["id"]) == (4001, 2001, row.notes, str(row.id))


def test_what_a_client_has_is_not_read(api: Api) -> None:
    fleet = api.fleet()
    row, viewer, stranger = seed_set(api, fleet, 1), api.member(fleet, "viewer"), api.member(api.fleet(), "admin")
    said = []
    event.listen(api.database.engine, "before_cursor_execute", lambda *given: said.append(given[2]))
    path = f"/correspondence-sets/{row.id}"
    assert viewer.get(path, headers={"If-None-Match": '"0"'}).status_code == 304
    assert stranger.get(path).status_code == 404
    assert any("FROM correspondence_set" in one for one in said)
    assert not any("correspondence_set.pairs" in one for one in said)
    assert viewer.get(path).status_code == 200
    assert any("correspondence_set.pairs" in one for one in said)


def peak_of_this_process() -> int:
    """The most memory since it was last reset, in bytes."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) * 1024


def test_twelve_at_once_cost_little_more_than_a_few(served: tuple[Api, str]) -> None:
    """Before, each took 17 MiB for 1 MB of numbers, and all twelve at once."""
    api, url = served
    fleet = api.fleet()
    row, viewer = seed_set(api, fleet, COUNT), api.member(fleet, "viewer")
    statuses: list[int] = []

    def get() -> None:
        path, status, size = f"{url}/v1/correspondence-sets/{row.id}", 503, 0
        while status == 503:  # on a busy machine the last ones wait longer than anybody is let wait
            with httpx.stream("GET", path, headers=viewer.headers, timeout=120) as answer:
                status, size = answer.status_code, sum(map(len, answer.iter_bytes()))
        if size > 100 * COUNT:
            statuses.append(status)

    get()
    Path("/proc/self/clear_refs").write_text("5")
    before = peak_of_this_process()
    threads = [threading.Thread(target=get) for _ in range(12)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert statuses == [200] * 13
    assert peak_of_this_process() - before < 150 * MIB


def test_who_finds_no_place_waits_and_is_then_told(served: tuple[Api, str]) -> None:
    api, url = served
    api.app.state.threads.memory._heavy = ConcurrencyLimiter(1, 1, 0.2)
    fleet = api.fleet()
    row, viewer = seed_set(api, fleet, COUNT), api.member(fleet, "viewer")
    path = f"{url}/v1/correspondence-sets/{row.id}"
    with httpx.Client(headers=viewer.headers, timeout=60) as client, client.stream("GET", path) as first:
        refused = client.get(path)
        assert (refused.status_code, refused.json()["code"], refused.headers["retry-after"]) == (503, "busy", "2")
        assert first.read()
        assert client.get(path).status_code == 200, "the place is free again"


def test_a_calibration_of_many_pairs_needs_a_place_too(api: Api) -> None:
    large, small = (seed_set(api, api.fleet(), count) for count in (COUNT, 200))
    owner = api.owner()

    def ask(pairs: CorrespondenceSet) -> Any:
        body = {"correspondence_set_ids": [str(pairs.id)], "models": ["pinhole"], "folds": 0}
        return owner.post(f"/vehicles/{pairs.vehicle_id}/calibrations", body)

    assert (ask(large).status_code, ask(small).status_code) == (202, 202)
    api.app.state.threads.memory._heavy = ConcurrencyLimiter(0, 1, 0.1)
    assert (ask(large).json()["code"], ask(small).status_code) == ("busy", 202)


@pytest.mark.parametrize("given", [b"x,y,z,u,v\n1,2,3,4,5\n", b'{"pairs":[{"x":1,"y":2,"z":3,"u":4,"v":5}]}'])
def test_imports_share_places_too(api: Api, given: bytes) -> None:
    fleet = api.fleet()
    rig, engineer = seed_rig(api.database, fleet), api.member(fleet, "engineer")
    headers = {"Content-Type": "application/json" if given.startswith(b"{") else "text/csv"}
    path = f"/rigs/{rig.id}/correspondence-sets?camera=front"
    for _ in range(3):
        assert engineer.post(path, content=given, headers=headers).status_code in (200, 201)
    api.app.state.threads.memory._light = ConcurrencyLimiter(0, 1, 0.1)
    assert engineer.post(path, content=given, headers=headers).json()["code"] == "busy"


def test_bodies_that_are_still_on_their_way_hold_no_place_of_an_import(served: tuple[Api, str]) -> None:
    api, url = served
    api.app.state.threads.memory._light = ConcurrencyLimiter(1, 1, 0.2)
    fleet = api.fleet()
    rig = seed_rig(api.database, fleet)
    path = f"{url}/v1/rigs/{rig.id}/correspondence-sets?camera=front"
    slow, quick = api.member(fleet, "engineer"), api.member(fleet, "engineer")
    began, go_on = threading.Event(), threading.Event()
    statuses: list[int] = []

    def slowly() -> Iterator[bytes]:
        yield b"x,y,z,u,v\n"
        began.set()  # asked for only once the line before is sent
        go_on.wait(120)
        yield b"1,2,3,4,5\n"

    def post_slowly() -> None:
        answer = httpx.post(path, content=slowly(), headers={**slow.headers, "Content-Type": "text/csv"}, timeout=60)
        statuses.append(answer.status_code)

    thread = threading.Thread(target=post_slowly)
    thread.start()
    assert began.wait(120)
    given = b"x,y,z,u,v\n5,4,3,2,1\n"
    answer = httpx.post(path, content=given, headers={**quick.headers, "Content-Type": "text/csv"}, timeout=60)
    go_on.set()
    thread.join()
    assert (answer.status_code, statuses) == (201, [201])


def test_a_selection_names_its_set_and_copies_nothing(api: Api) -> None:
    fleet = api.fleet()
    row, engineer = seed_set(api, fleet, 4001), api.member(fleet, "engineer")
    said: list[str] = []
    event.listen(api.database.engine, "before_cursor_execute", lambda *given: said.append(given[2]))

    def select(of: str, *left_out: int) -> dict[str, Any]:
        answer = engineer.post(f"/correspondence-sets/{of}/selections", {"leave_out": left_out})
        assert answer.status_code in (200, 201), answer.text
        return answer.json()

    first = select(str(row.id), 0, 3)
    second = select(first["id"], 0, 3998)  # 1 and 4000 of the whole set
    assert [(one["count"], one["flagged"]) for one in (first, second)] == [(3999, 2000), (3997, 1999)]
    assert select(first["id"], 3998, 0)["id"] == second["id"]
    assert first["notes"][-1] == "2 pairs were left out by hand."
    for left_out, code in (([4001], "no_such_pair"), ([*range(4001)], "nothing_left")):
        refused = engineer.post(f"/correspondence-sets/{row.id}/selections", {"leave_out": left_out})
        assert (refused.status_code, refused.json()["code"]) == (422, code)
    assert not any("correspondence_set.pairs AS" in one for one in said), "16 MB of a large set"
    kept = [i for i in range(4001) if i not in (0, 1, 3, 4000)]
    pairs = engineer.get(f"/correspondence-sets/{second['id']}").json()["pairs"]
    assert pairs == [{name: values[i] for name, values in row.columns.items()} for i in kept]
    with api.database.reading() as session:
        stored = session.get_one(CorrespondenceSet, UUID(second["id"]))
        assert (stored.pairs, stored.whole_id, stored.left_out) == (None, row.id, [0, 1, 3, 4000])
