"""An ingestion that lost its job does nothing to the recording; one that reads strange names stores them legibly."""

import hashlib
import json
import threading
import time
from dataclasses import replace
from pathlib import Path

import pytest
from sqlalchemy import delete, select

from service.platform.db.models import (
    AuditEntry,
    Blob,
    Publication,
    Recording,
    Rig,
    RigCamera,
    Sensor,
    UploadPart,
    Vehicle,
)
from service.platform.jobs.claims import Lease, LostLeaseError, claim, finishing
from service.platform.jobs.queue import cancel, enqueue
from service.platform.jobs.reaper import reap
from service.platform.settings import Settings
from service.recordings.actions import delete_recording
from tests.service.detections.seeding import seed_recording, seed_rig
from tests.service.platform.jobs.support import make_fleet
from tests.support.databases import one_database
from tests.support.leases import let_lease_expire
from tests.support.rows import add
from tests.support.work import work
from tests.workers.readers.making_recordings import clouds, header, images, interleaved, png, write_bag
from workers.readers import limited
from workers.tasks.context import Context
from workers.tasks.ingesting import ingest
from workers.tasks.originals import plain_name, reading_limits
from workers.tasks.running import run_job


@pytest.mark.parametrize(
    ("file_name", "plain"),
    [
        ("walk.pcap", "walk.pcap"),
        ("../../etc/passwd", "_.._etc_passwd"),
        ("Fahrt über Land.bag", "Fahrt_ber_Land.bag"),
        ("...", "recording"),
        ("x" * 150 + ".mp4", "x" * 96 + ".mp4"),
    ],
)
def test_the_original_is_named_as_its_owner_does_as_far_as_that_is_harmless(file_name, plain):
    assert plain_name(file_name) == plain


def test_a_frozen_worker_does_not_put_a_ready_recording_back(context, database):
    fleet_id = make_fleet(database)
    recording_id, _ = seed_recording(database, seed_rig(database, fleet_id), 2)
    with database.writing() as session:
        session.get_one(Recording, recording_id).state = "queued"
        job_id = enqueue(session, kind="ingest", fleet_id=fleet_id, subject_id=recording_id).id
    frozen = claim(database, job_id, "frozen")
    let_lease_expire(database, job_id)
    reap(database, context.store)
    with finishing(database, claim(database, job_id, "second")):
        pass
    with pytest.raises(LostLeaseError), Lease(database, frozen) as lease:
        ingest(context, frozen, lease)
    with database.reading() as session:
        assert session.get_one(Recording, recording_id).state == "ready"


def uploaded(context: Context, rig: Rig, file: Path) -> Recording:
    """A recording whose original is this file, about to be ingested."""
    data = file.read_bytes()
    sha256 = hashlib.sha256(data).hexdigest()
    key = f"recordings/{file.stem}/parts/1/{sha256[:32]}"
    context.store.put_bytes(key, data)
    with context.database.writing() as session:
        named = {"name": file.stem, "file_name": file.name, "state": "queued"}
        row = add(session, Recording, rig, size=len(data), **named)
        add(session, Blob, key=key, size=len(data), sha256=sha256)
        add(session, UploadPart, row, number=1, blob_key=key, size=len(data), sha256=sha256)
        row.job_id = enqueue(session, kind="ingest", fleet_id=rig.fleet_id, subject_id=row.id).id
        return row


def test_names_from_a_file_are_stored_legibly(context, database, tmp_path):
    rig = seed_rig(database, make_fleet(database))
    sweeps = [
        ("/points\0\x07", kind, at, replace(message, header=header(at, "velo\0dyne\n")))
        for _, kind, at, message in clouds(3)
    ]
    frames = list(images(3, "/cam\0era/compressed", png(640, 480)))
    plain = uploaded(context, rig, write_bag(tmp_path / "one.bag", interleaved(sweeps, frames)))
    others = [("/oth\0er", kind, at, message) for _, kind, at, message in sweeps]
    refused = uploaded(context, rig, write_bag(tmp_path / "two.bag", interleaved(sweeps, others, frames)))
    work(context)
    with database.reading() as session:
        row = session.get_one(Recording, plain.id)
        assert (row.state, row.problem) == ("ready", None)
        sensors = session.scalars(select(Sensor).where(Sensor.recording_id == row.id).order_by(Sensor.kind))
        camera, lidar = sensors
        assert (lidar.topic, lidar.frame_id) == (r"/points\x00\x07", r"velo\x00dyne\n")
        assert camera.topic == r"/cam\x00era/compressed"
        assert r"\u0000" not in json.dumps([camera.facts, lidar.facts, row.facts, row.warnings])
        problem = session.get_one(Recording, refused.id).problem
        assert problem["code"] == "ambiguous_lidar" and r"/oth\x00er" in problem["detail"], problem


@one_database
def test_a_rig_without_cameras_is_described_by_the_recording(context, database, tmp_path):
    rig = seed_rig(database, make_fleet(database))
    with database.writing() as session:
        session.execute(delete(RigCamera))
        # What was withdrawn is told to cars once a rig has the camera: the worker's role writes that into the audit.
        add(session, Publication, session.get_one(Vehicle, rig.vehicle_id))
    sweeps = [(topic, kind, at, replace(one, header=header(at, "velodyne"))) for topic, kind, at, one in clouds(3)]
    frames = list(images(3, "/camera/front/image_raw/compressed", png(640, 480)))
    first = uploaded(context, rig, write_bag(tmp_path / "one.bag", interleaved(sweeps, frames)))
    again = uploaded(context, rig, write_bag(tmp_path / "two.bag", interleaved(sweeps, frames)))
    blind = uploaded(context, empty(database, rig), write_bag(tmp_path / "three.bag", sweeps))
    work(context)
    with database.reading() as session:
        assert [session.get_one(Recording, row.id).state for row in (first, again, blind)] == ["ready"] * 3
        described = session.get_one(Rig, rig.id)
        (camera,) = described.cameras
        assert (described.lidar.frame, described.lidar.topic, described.version) == ("velodyne", "/points", 2)
        assert (camera.name, camera.topic) == ("front", "/camera/front/image_raw/compressed")
        assert (camera.image_width, camera.image_height, camera.images["kind"]) == (640, 480, "raw")
        warned = session.get_one(Recording, first.id).warnings
        assert any("how front is mounted" in one and "Assumed: forward" in one for one in warned)
        assert not any("Assumed" in one for one in session.get_one(Recording, again.id).warnings)
        assert any("The rig is not described." in one for one in session.get_one(Recording, blind.id).warnings)
        (effect,) = session.scalars(select(AuditEntry.effect))
        assert "car, front: nothing -> nothing, it was withdrawn (410)" in effect.splitlines()


def empty(database, rig):
    with database.writing() as session:
        return add(session, Rig, session.get_one(Vehicle, rig.vehicle_id), name="empty")


def gone(pid):
    """Whether a process has ended; one that nobody waited for yet has."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except (FileNotFoundError, ProcessLookupError):
        return True


@pytest.mark.parametrize("how", ["deleted", "cancelled", "lost"])
def test_a_child_that_hangs_ends_with_its_job(context, database, tmp_path, monkeypatch, how):
    """It says nothing at all, as one that is busy with an endless query does."""
    rig = seed_rig(database, make_fleet(database))
    recording = uploaded(context, rig, write_bag(tmp_path / "one.bag", clouds(2)))
    pids = tmp_path / "pids"
    hanging = tmp_path / "python"
    hanging.write_text(f"#!/bin/sh\nsleep 300 & echo $$ $! > {pids}; wait\n")
    hanging.chmod(0o755)
    monkeypatch.setattr(limited.sys, "executable", str(hanging))
    ended = []

    def end_it():
        while not (pids.exists() and pids.read_text().endswith("\n")):
            time.sleep(0.02)
        if how == "lost":
            let_lease_expire(database, recording.job_id)
            reap(database, context.store)
        else:
            with database.writing() as session:
                if how == "deleted":
                    delete_recording(session, recording.id, with_published=False)
                else:
                    cancel(session, [recording.id])
        began = time.monotonic()
        while not all(gone(int(pid)) for pid in pids.read_text().split()):
            time.sleep(0.02)
        ended.append(time.monotonic() - began)

    other = threading.Thread(target=end_it, daemon=True)
    other.start()
    run_job(context, recording.job_id)
    other.join(timeout=60)
    # A second between two looks, a fifth to act; the rest is for a busy machine. By itself it ends after 60 s.
    assert ended and ended[0] < 20
    with database.reading() as session:
        row = session.get(Recording, recording.id)
        assert (row is None) == (how == "deleted")
    assert not list(context.settings.scratch.glob("*"))


def test_limits_follow_the_upload_and_stay_within_the_task():
    settings = Settings(task_limit_s=1800)
    small, large = reading_limits(settings, 10_000), reading_limits(settings, 10 * 1024**3)
    assert 120 <= small.wall_s < 121 and large.wall_s == 1440
    assert small.reserve_bytes == settings.min_free_bytes
    # 209 kB once became 400 MiB.
    assert small.output_bytes(209_000, video=False) < 21 * 1024**2
