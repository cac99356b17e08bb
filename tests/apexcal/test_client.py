"""The client against a served service: uploads that break off, problems, sign-in, and the whole job."""

import json
import re
import socket
import threading
import time

import httpx
import pytest

from apexcal.client import ApiError, Client, ClientError, TooSlowError
from apexcal.documents.recordings import Parts
from apexcal.rigs import read_rig
from apexcal.transport import HttpTransport
from apexcal.upload_sources import open_source
from apexcal.uploads import send_parts
from tests.support.asking import leave_marks_to_people

KEEP = {"all": [{"quantity": "x", "op": ">", "value": 2}, {"quantity": "z", "op": ">", "value": -1.7}]}


@pytest.fixture
def rig(owner, simulated):
    fleet = owner.fleets.create(f"Fleet {time.monotonic_ns()}")
    vehicle = owner.vehicles.create(fleet.id, "Car")
    return owner.vehicles.create_rig(vehicle.id, read_rig(simulated / "rig.json", "Rig"))


@pytest.fixture
def large(tmp_path):
    """A file of three parts and a piece."""
    path = tmp_path / "large.bag"
    with path.open("wb") as file:
        for number in range(50):
            file.write(bytes([number]) * (1 << 20))
    return path


class InterruptedUploadError(Exception):
    pass


def test_an_interrupted_upload_sends_only_what_is_missing(owner, rig, large):
    recording = owner.recordings.create(rig.vehicle_id, rig.id, "Large", large.name)
    http = HttpTransport(owner.base_url, token=owner._http._http.headers["Authorization"].removeprefix("Bearer "))

    def interrupt(done: int, total: int) -> None:
        if done > total / 3:
            raise InterruptedUploadError

    with pytest.raises(InterruptedUploadError):
        send_parts(http, recording, open_source(large), interrupt, connections=1)
    held = {part.number for part in http.get(f"/recordings/{recording.id}/parts", Parts).items}
    assert held
    assert len(held) < 4
    puts = []
    owner._http._http.event_hooks["request"].append(lambda request: puts.append((request.method, request.url.path)))
    resumed = owner.recordings.upload(large, rig.vehicle_id, rig.id, resume=True)
    assert resumed.id == recording.id
    numbers = {int(path.rsplit("/", 1)[1]) for method, path in puts if method == "PUT"}
    assert numbers == {1, 2, 3, 4} - held
    http.close()


def test_going_on_with_another_file_is_refused_before_anything_is_sent(owner, rig, large):
    recording = owner.recordings.create(rig.vehicle_id, rig.id, "Large", large.name)
    send_parts(owner._http, recording, open_source(large))
    with large.open("r+b") as file:
        file.write(b"other")
    with pytest.raises(ClientError, match="part 1 differs"):
        owner.recordings.resume(recording, large)


def test_a_lost_answer_creates_nothing_twice(owner):
    """The request reaches the service, its answer does not reach the client, which asks again."""
    target = httpx.URL(owner.base_url)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        proxy = threading.Thread(target=_lose_first_answer, args=(listener, (target.host, target.port)), daemon=True)
        proxy.start()
        token = owner._http._http.headers["Authorization"].removeprefix("Bearer ")
        with Client(f"http://127.0.0.1:{listener.getsockname()[1]}", token) as lossy:
            name = f"Lossy {time.monotonic_ns()}"
            made = lossy.fleets.create(name)
        proxy.join(10)
    assert [fleet.id for fleet in owner.fleets.list() if fleet.name == name] == [made.id]


def _lose_first_answer(listener: socket.socket, target: tuple[str, int]) -> None:
    for forward_answer in (False, True):
        near, _ = listener.accept()
        with near, socket.create_connection(target) as far:
            far.sendall(_message(near))
            answer = _message(far)
            if forward_answer:
                near.sendall(answer)


def _message(connection: socket.socket) -> bytes:
    """One whole HTTP message."""
    head = b""
    while not head.endswith(b"\r\n\r\n"):
        head += connection.recv(1)
    length = int(re.search(rb"content-length: (\d+)", head.lower()).group(1))
    body = b""
    while len(body) < length:
        body += connection.recv(length - len(body))
    return head + body


def test_a_sign_in_link_works_once(owner, rig):
    link = owner.fleets.invite(rig.fleet_id, "Ada", "annotator").link
    with Client.sign_in(link) as ada:
        assert ada.me().name == "Ada"
        assert [(fleet.id, fleet.role) for fleet in ada.me().fleets] == [(rig.fleet_id, "annotator")]
        with pytest.raises(ApiError) as used:
            Client.sign_in(link)
        assert used.value.code == "link_used"
        ada.sign_out()
        with pytest.raises(ApiError):
            ada.me()
    with pytest.raises(ClientError, match="no sign-in link"):
        Client.sign_in(link.split("#", maxsplit=1)[0])


def test_frames_vertices_and_marks_that_outlive_a_pairing(owner, rig, simulated):
    """What the program of `docs/api.md`, which goes on to a published calibration, does not look at."""
    progress = []
    uploaded = owner.recordings.upload(simulated / "recording.bag", rig.vehicle_id, rig.id)
    recording = owner.wait(uploaded, on_progress=lambda *each: progress.append(each))
    assert progress[-1] == (1.0, "ready")
    truth = json.loads((simulated / "truth.json").read_text())["frames"]
    frames = list(owner.recordings.frames(recording.id, "front"))
    assert [frame.stamp_ns for frame in frames] == truth["stamp_ns"]
    assert owner.recordings.frame(recording.id, "front", 3).startswith(b"\xff\xd8\xff")
    assert owner.recordings.edit(recording, name="Renamed").name == "Renamed"
    with pytest.raises(ApiError) as stale:
        owner.recordings.edit(recording, name="Again")
    assert stale.value.code == "version_conflict"
    loose = {"detector": "tolerant", "options": {"min_points": 3, "min_points_two_below": 0}}
    detection = owner.wait(owner.detections.create(recording.id, KEEP, **loose))
    leave_marks_to_people(owner, recording.id)
    assert len(list(owner.detections.vertices(detection.id))) == detection.counts.accepted
    assert list(owner.detections.vertices(detection.id, quality="fine")) == []
    pixels = dict(zip(truth["stamp_ns"], truth["apex_uv"], strict=True))
    with Client.sign_in(owner.fleets.invite(rig.fleet_id, "Bo", "annotator").link) as bo:
        while task := bo.marking.next_task(detection.id, "front"):
            u, v = pixels[task.frame.stamp_ns]
            bo.marking.answer(task.task_id, "confirmed", u=u, v=v)
    tally, done = owner.marking.tally(detection.id, "front"), owner.marking.progress(detection.id, "front")
    assert tally.marks == done.complete == done.vertices == len(list(owner.marking.marks(detection.id, "front")))
    started = owner.detections.create(recording.id, KEEP, **loose, max_gap_ns=20_000_000, mode="interpolate")
    moved = owner.wait(started)
    leave_marks_to_people(owner, recording.id)
    pairs = owner.correspondence_sets.get(owner.correspondence_sets.build(moved.id, "front").id)
    assert pairs.count == moved.counts.paired > 0, "marks survive another run with another pairing"
    assert all(pair.gap_ns == 0 and 0 < pair.sigma_elevation_rad < 0.01 for pair in pairs.pairs)
    with pytest.raises(ApiError) as refused:
        owner.calibrations.create(rig.vehicle_id, [pairs.id], ["fisheye"])
    assert refused.value.code == "unknown_model"


def test_waiting_ends_when_the_caller_says_so(owner, rig, large):
    recording = owner.recordings.create(rig.vehicle_id, rig.id, "Never completed", large.name)
    with pytest.raises(TooSlowError, match="uploading"):
        owner.wait(recording, timeout_s=0.2)


def test_members_tokens_and_jobs(owner, rig, embedded):
    fleet_id = rig.fleet_id
    person = owner.fleets.invite(fleet_id, "Chidi", "viewer").person_id
    assert owner.fleets.set_role(fleet_id, person, "reviewer").role == "reviewer"
    made = owner.fleets.create_token(fleet_id, "logger", "viewer", expires_in_days=1)
    with Client(embedded.url, made.token) as program:
        assert [vehicle.id for vehicle in program.vehicles.list(fleet_id)] == [rig.vehicle_id]
        with pytest.raises(ApiError) as refused:
            program.vehicles.create(fleet_id, "No")
        assert refused.value.code == "role_too_low"
        owner.fleets.revoke_token(made.id)
        with pytest.raises(ApiError):
            program.me()
    owner.fleets.remove_member(fleet_id, person)
    assert person not in {member.person_id for member in owner.fleets.members(fleet_id)}
    assert list(owner.jobs(fleet_id=fleet_id)) == []
