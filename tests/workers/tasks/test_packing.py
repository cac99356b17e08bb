"""A recording is packed right after it was read; a second packing, or one without room, changes nothing."""

from uuid import UUID

import numpy as np
import pytest
from sqlalchemy import func, select

from apexcal.sweeps import unpack
from service.analyses.jobs import queue_packing
from service.platform.db.models import Analysis, Blob, Job, PackedSweep, PackedSweeps, Recording, Sensor
from service.platform.db.session import Database
from service.platform.jobs.claims import Lease, claim, finish
from service.platform.jobs.sweep import sweep
from service.platform.storage.quota import take
from tests.service.detections.seeding import seed_rig
from tests.service.platform.jobs.support import make_fleet
from tests.support.work import work
from tests.workers.readers.making_recordings import clouds, images, interleaved, png, write_bag
from tests.workers.tasks.test_ingesting import uploaded
from workers.readers.normalised.lidar_file import LidarFile
from workers.tasks.context import Context
from workers.tasks.packing import packing
from workers.tasks.running import run_job

pytestmark = pytest.mark.usefixtures("broker")


def bag(tmp_path):
    frames = list(images(4, "/camera/compressed", png(640, 480)))
    return write_bag(tmp_path / "one.bag", interleaved(clouds(4), frames))


def ingested(context: Context, database: Database, tmp_path) -> UUID:
    """The id of a recording of four sweeps, after all its jobs."""
    recording = uploaded(context, seed_rig(database, make_fleet(database)), bag(tmp_path))
    work(context)
    return recording.id


def analyses(database: Database) -> list[Analysis]:
    with database.reading() as session:
        return list(session.scalars(select(Analysis).order_by(Analysis.created_at, Analysis.id)))


def test_every_sweep_lies_where_its_row_says(context, database, tmp_path):
    recording_id = ingested(context, database, tmp_path)
    (analysis,) = analyses(database)
    assert (analysis.kind, analysis.state, analysis.problem) == ("packing", "done", None)
    with database.reading() as session:
        lidar = session.scalars(
            select(Sensor).where(Sensor.recording_id == recording_id, Sensor.kind == "lidar")
        ).one()
        packed = session.get_one(PackedSweeps, lidar.id)
        rows = session.scalars(select(PackedSweep).order_by(PackedSweep.index)).all()
        sizes = session.scalar(select(func.sum(Blob.size)).where(Blob.state == "stored"))
        assert session.get_one(Recording, recording_id).taken_bytes == sizes
        assert session.get_one(Blob, packed.blob_key).state == "stored"
    whole = b"".join(context.store.stream(packed.blob_key))
    assert analysis.result == {"sweeps": 4, "points": sum(row.points for row in rows), "bytes": len(whole)}
    with LidarFile(context.store.local_path(lidar.blob_key)) as file:
        assert [row.stamp_ns for row in rows] == file.stamps_ns.tolist()
        for row in rows:
            points = unpack(whole[row.offset : row.offset + row.length])
            given = file.sweep(row.index)
            assert points.header.sweep_index == row.index and len(points.xyz) == row.points == len(given.xyz)
            order = np.argsort(given.ring, kind="stable")
            assert np.abs(points.xyz - given.xyz[order]).max() < 0.00051


def test_packing_again_changes_nothing(context, database, tmp_path):
    recording_id = ingested(context, database, tmp_path)
    with database.writing() as session:
        before = session.scalars(select(PackedSweeps.blob_key)).one()
        queue_packing(session, recording_id, session.get_one(Recording, recording_id))
    work(context)
    first, second = analyses(database)
    assert second.state == "done" and second.result == first.result
    with database.reading() as session:
        assert session.scalars(select(PackedSweeps.blob_key)).one() == before


def test_of_two_packings_at_once_the_first_is_kept(context, database, tmp_path):
    """Both have computed before either commits: the second neither replaces the first's bytes nor its rows."""
    recording = uploaded(context, seed_rig(database, make_fleet(database)), bag(tmp_path))
    run_job(context, recording.job_id)
    with database.writing() as session:
        queue_packing(session, recording.id, session.get_one(Recording, recording.id))
    with database.reading() as session:
        ids = session.scalars(select(Job.id).where(Job.kind == "packing").order_by(Job.id)).all()
    held = [claim(database, job_id, "w") for job_id in ids]
    writes = []
    for one in held:
        with Lease(database, one) as lease:
            writes.append(packing(context, one, lease))
    kept = []
    for one, write in zip(held, writes, strict=True):
        finish(database, one, write)
        with database.reading() as session:
            rows = session.execute(select(PackedSweep.index, PackedSweep.offset, PackedSweep.length)).all()
            kept.append((session.scalars(select(PackedSweeps.blob_key)).one(), rows))
    assert len(kept) == 2 and kept[0] == kept[1] and len(kept[0][1]) == 4
    assert [one.state for one in analyses(database)] == ["done"] * 2
    sweep(database, context.store)
    with database.reading() as session:
        packed = session.scalars(select(Blob.key).where(Blob.key.contains("/sweeps"))).all()
    assert packed == [kept[0][0]] and context.store.local_path(packed[0])


def test_a_fleet_without_room_keeps_its_recording_and_hears_why(context, database, tmp_path, monkeypatch):
    def full(session, recording, size, default):
        take(session, recording, size, recording.taken_bytes)

    monkeypatch.setattr("workers.tasks.analysis_files.take", full)
    recording_id = ingested(context, database, tmp_path)
    (analysis,) = analyses(database)
    assert (analysis.state, analysis.problem["code"]) == ("failed", "fleet_quota_exceeded")
    sweep(database, context.store)
    with database.reading() as session:
        row = session.get_one(Recording, recording_id)
        assert row.state == "ready" and session.scalars(select(PackedSweeps)).all() == []
        stored = session.scalar(select(func.sum(Blob.size)).where(Blob.state == "stored"))
        assert row.taken_bytes == stored
