"""An ingestion that lost its job does nothing to the recording."""

import pytest

from service.db.models import Recording
from service.jobs.claims import Lease, LostLeaseError, claim, finishing
from service.jobs.queue import enqueue
from service.jobs.sweep import sweep
from tests.service.detections.seeding import seed_recording, seed_rig
from tests.service.jobs.support import let_lease_expire, make_fleet
from workers.tasks.ingesting import _plain_name, ingest


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
    assert _plain_name(file_name) == plain


def test_a_frozen_worker_does_not_put_a_ready_recording_back(context, database):
    fleet_id = make_fleet(database)
    recording_id, _ = seed_recording(database, seed_rig(database, fleet_id), 2)
    with database.writing() as session:
        session.get_one(Recording, recording_id).state = "queued"
        job_id = enqueue(session, kind="ingest", fleet_id=fleet_id, subject_id=recording_id).id
    frozen = claim(database, job_id, "frozen")
    let_lease_expire(database, job_id)
    sweep(database, context.store)
    with finishing(database, claim(database, job_id, "second")):
        pass
    with pytest.raises(LostLeaseError), Lease(database, frozen) as lease:
        ingest(context, frozen, lease)
    with database.reading() as session:
        assert session.get_one(Recording, recording_id).state == "ready"
