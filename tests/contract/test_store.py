"""A worker whose store fails it: what is wrong with the bytes is said, what passes is tried again."""

import pytest
from sqlalchemy import select

from service.platform.db.models import Job, UploadPart
from service.platform.storage.store import Store
from tests.service.platform.jobs.support import let_backoff_end
from tests.support.processes import free_port
from tests.support.uploads import new_recording, upload
from tests.support.work import work
from workers.tasks.running import run_job

pytestmark = pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)


@pytest.fixture
def uploaded(engineer, fleet):
    made = new_recording(engineer, fleet)
    assert upload(engineer, made["id"], [b"first", b"second"]).status_code == 202
    return made["id"]


def key_of_part(api, number: int) -> str:
    with api.database.reading() as session:
        return session.scalars(select(UploadPart.blob_key).where(UploadPart.number == number)).one()


def test_a_part_that_changed_in_the_store_is_named(api, context, engineer, uploaded):
    context.store.put_bytes(key_of_part(api, 2), b"secomd")
    work(context)
    failed = engineer.get(f"/recordings/{uploaded}").json()
    assert (failed["state"], failed["problem"]["code"]) == ("failed", "checksum_mismatch")
    assert failed["problem"]["detail"].startswith("Part 2 ")


def test_a_part_that_is_gone_from_the_store_is_named(api, context, engineer, uploaded):
    key = key_of_part(api, 1)
    context.store.delete(key)
    work(context)
    failed = engineer.get(f"/recordings/{uploaded}").json()
    assert (failed["state"], failed["problem"]["code"]) == ("failed", "blob_missing")
    assert key in failed["problem"]["hint"]


def test_a_store_that_is_away_is_tried_again(api, context, engineer, uploaded, s3_server):
    options = s3_server.options(endpoint=f"http://127.0.0.1:{free_port()}", timeout_s=0.3)
    context.store, folder = Store("s3://nowhere", options), context.store
    with api.database.reading() as session:
        job_id = session.scalars(select(Job.id)).one()
    run_job(context, job_id)
    with api.database.reading() as session:
        job = session.get_one(Job, job_id)
    assert (job.state, job.lost) == ("queued", 1)
    context.store = folder
    let_backoff_end(context.database)
    work(context)
    assert engineer.get(f"/recordings/{uploaded}").json()["problem"]["code"] == "not_a_recording"
