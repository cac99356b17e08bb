"""Whatever dies at whatever moment: each request ends exactly once, with the bits of an undisturbed run."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from itertools import count
from pathlib import Path

import psycopg
import pytest
from sqlalchemy import func, select
from sqlalchemy.engine import make_url

from service.platform.db.models import Blob, Job, Recording, Result, Slot
from service.platform.jobs.messages import Message, Sender
from service.platform.jobs.queue import answering_workers
from service.platform.storage.store import MARKER
from tests.faults.farm import LEASE_S, Farm, seconds_of
from tests.faults.jobs import REGION, Walk, ask, ask_two_cameras, new_rig
from tests.faults.results import slot_bests
from tests.support.asking import leave_marks_to_people
from tests.support.processes import wait_until
from tests.support.proxies import Proxy
from tests.support.wrong_clocks import why_not

pytestmark = pytest.mark.faults
# A lease and two periods of the sweep are 3 s; the rest is for a busy machine.
_RECOVERED_S = 300.0
_names = (f"fleet {number}" for number in count())


@pytest.fixture(scope="module")
def undisturbed(farm: Farm):
    """What the calibration finds when nothing happens, and how long it takes."""
    began = time.monotonic()
    calibration = farm.finished(ask(farm.client, next(_names)))
    assert calibration.state == "done"
    return farm.documents(calibration), time.monotonic() - began


def assert_ended_once_with_the_same_bits(farm: Farm, calibration, undisturbed) -> None:
    calibration = farm.finished(calibration)
    assert calibration.state == "done"
    assert farm.documents(calibration) == undisturbed[0]
    with farm.database.reading() as session:
        runs = list(session.scalars(select(Result.run_id)).all())
        assert len(runs) == len(set(runs))
        twice = select(Slot.run_id).group_by(Slot.run_id, Slot.iteration, Slot.slot).having(func.count() > 1)
        assert session.execute(twice).all() == []


def test_a_worker_process_killed_within_a_slot_and_the_sweeper_before_it(farm: Farm, undisturbed):
    began = time.monotonic()
    calibration = ask(farm.client, next(_names))
    farm.kill("sweeper")
    farm.start("sweeper")
    job_id = farm.kill_who_works_on("solve", "slots")
    assert_ended_once_with_the_same_bits(farm, calibration, undisturbed)
    later = time.monotonic() - began - undisturbed[1]
    assert farm.job(job_id).lost == 1
    # The lease, and what a busy machine takes for the work that is done again; without the lease it never ends.
    assert later < LEASE_S + 300


def test_the_whole_worker_killed(farm: Farm, undisturbed):
    """The next one has one process, as the test after this wants it."""
    calibration = ask(farm.client, next(_names))
    wait_until(lambda: _running(farm) != [], "work")
    farm.kill("worker")
    farm.use_worker(1)
    assert_ended_once_with_the_same_bits(farm, calibration, undisturbed)


def test_two_cameras_by_one_process_and_by_four_farmed_either_way_end_with_the_same_bits(farm: Farm):
    """Every slot's best, every result and the comparison of the cameras, from the request and its seed alone."""
    farm.use_worker(1)
    by_one_process = of_two_cameras(farm, "runs")
    farm.use_worker(4)
    found = of_two_cameras(farm, "slots")
    assert found == by_one_process
    seed, documents, slots, *_ = found
    for document in documents.values():
        assert document["provenance"]["request"]["seed"] == seed
        assert document["cpu"]["target"] and len(document["provenance"]["sources_sha256"]) == 64
    assert {(camera, model) for camera, model, *_ in slots} == {key[:2] for key in documents}


def of_two_cameras(farm: Farm, way: str):
    """The seed of a calibration of two cameras, and all that came of it."""
    calibration = farm.finished(ask_two_cameras(farm.client, next(_names), farm=way), 200)
    assert (calibration.state, calibration.problem) == ("done", None)
    summary = calibration.summary
    assert [pair.name for pair in summary.rig.pairs] == ["T_front_left"]
    why = {camera: one.why for camera, one in summary.cameras.items()}
    documents = farm.documents(calibration)
    assert len(documents) == 2 * 3
    return calibration.request.seed, documents, bests_of(farm, calibration), summary.rig, why


def bests_of(farm: Farm, calibration):
    with farm.database.reading() as session:
        return slot_bests(session, calibration.id)


def test_the_api_killed_between_commit_and_send(farm: Farm, undisturbed):
    """The client repeats its request with the same idempotency key, so the one calibration is not made twice."""
    name = next(_names)
    farm.fuse.touch()
    with ThreadPoolExecutor() as pool:
        asked = pool.submit(ask, farm.client, name)
        wait_until(lambda: farm.is_dead("api"), "the API's death")
        farm.start("api")
        calibration = asked.result()
    assert len(list(farm.client.calibrations.list(calibration.vehicle_id))) == 1
    assert_ended_once_with_the_same_bits(farm, calibration, undisturbed)


def test_every_message_delivered_three_times(farm: Farm, undisturbed):
    calibration = ask(farm.client, next(_names))
    sender = Sender(farm.broker.url)
    seen: set[int] = set()
    while farm.client.calibrations.get(calibration.id).state not in ("done", "failed"):
        with farm.database.reading() as session:
            ids = session.scalars(select(Job.id).where(Job.kind == "solve", Job.state != "done")).all()
        sender([Message(job_id, "solve") for job_id in ids if job_id not in seen] * 2)
        seen.update(ids)
        time.sleep(0.05)
    sender.close()
    assert seen
    assert_ended_once_with_the_same_bits(farm, calibration, undisturbed)


def test_a_worker_told_to_stop_gives_its_job_back_uncounted_and_a_cancel_ends_it(farm: Farm):
    long = {"slots": 1, "population": 19_000, "generations": 10_000, "max_iterations": 1}
    calibration = ask(farm.client, next(_names), schedule=long)
    wait_until(lambda: _running(farm) != [], "work")
    (job_id,) = _running(farm)
    # Before the end of the slot, which is as long as one may be.
    assert seconds_of(lambda: farm.stop("worker")) < 20
    assert (farm.job(job_id).state, farm.job(job_id).lost) == ("queued", 0)
    farm.use_worker(2)
    wait_until(lambda: farm.job(job_id).state == "running", "another claim")
    farm.client.calibrations.cancel(calibration.id)
    wait_until(lambda: farm.job(job_id).state == "cancelled", "the cancel")
    assert farm.client.calibrations.get(calibration.id).state == "cancelled"


def _running(farm: Farm) -> list[int]:
    with farm.database.reading() as session:
        return list(session.scalars(select(Job.id).where(Job.kind == "solve", Job.state == "running")))


def test_a_whole_run_killed_at_work_ends_the_calibration_once(farm: Farm):
    """The sweep gives the job to another."""
    calibration = ask_two_cameras(farm.client, next(_names), farm="runs", folds=0)
    job_id = farm.kill_who_works_on("solve", "run")
    ended = farm.finished(calibration)
    assert ended.state == "done" and len(ended.summary.rig.pairs) == 1
    assert (farm.job(job_id).lost, farm.job(job_id).attempt) == (1, 2)


@pytest.mark.parametrize("seconds", [5, pytest.param(20, marks=pytest.mark.slow)])
def test_the_broker_stopped_for_a_while_and_started_empty(farm: Farm, undisturbed, seconds: int):
    calibration = ask(farm.client, next(_names))
    farm.broker.stop()
    with ThreadPoolExecutor() as pool:
        meanwhile = pool.submit(ask, farm.client, next(_names))
        time.sleep(seconds)
        farm.broker.start()
        assert_ended_once_with_the_same_bits(farm, calibration, undisturbed)
        assert_ended_once_with_the_same_bits(farm, meanwhile.result(), undisturbed)


@pytest.mark.skipif(bool(why_not()), reason=f"no clock can be set here: {why_not()}")
@pytest.mark.parametrize(
    ("farm", "parts"),
    [
        ("postgresql", ["sweeper", "worker"]),
        pytest.param("postgresql", ["api"], marks=pytest.mark.slow),
        # On one host all have one clock, and SQLite's is that one too.
        pytest.param("sqlite", ["sweeper", "worker", "api"], marks=pytest.mark.slow),
    ],
    indirect=["farm"],
    ids=lambda given: "-".join(given) if isinstance(given, list) else given,
)
def test_a_clock_that_steps_while_a_worker_dies(farm: Farm, undisturbed, parts: list[str]):
    """An hour back, an hour ahead, ten seconds back. By the clock of day nothing was found for an hour."""
    wrong_s = 0
    for step_s in (-3600, 3600, -10):
        calibration = ask(farm.client, next(_names))
        job_id = farm.kill_who_works_on("solve", "slots")
        began = time.monotonic()
        wrong_s += step_s
        for part in parts:
            farm.clocks[part].step(wrong_s)
        wait_until(lambda job_id=job_id: farm.job(job_id).attempt == 2, "the next attempt", _RECOVERED_S)
        print(f"{parts} {step_s:+d} s: recovered after {time.monotonic() - began:.1f} s")
        assert farm.is_ready()
        assert_ended_once_with_the_same_bits(farm, calibration, undisturbed)
        assert farm.job(job_id).lost == 1
    for part in parts:
        farm.clocks[part].step(0)


@pytest.mark.parametrize("farm", ["postgresql"], indirect=True)
def test_a_worker_that_cannot_reach_the_database_takes_no_messages(farm: Farm, undisturbed):
    """Beside a healthy one: it leaves the work to that one, and takes part again when it can."""
    folder = Path(make_url(farm.database_url).query["host"])
    proxy = Proxy(str(folder / ".s.PGSQL.5432"))
    behind = make_url(farm.database_url).set(host="127.0.0.1", port=proxy.port, query={})
    farm.start_beside("cut-off", {"APEXCAL_DATABASE_URL": behind.render_as_string()})
    refusals = lambda: farm.log("cut-off").read_text().count("could not be claimed")  # noqa: E731
    try:
        wait_until(lambda: "cut-off" in _answering(farm), "the second worker")
        proxy.cut()
        wait_until(lambda: "cut-off" not in _answering(farm), "its silence", _RECOVERED_S)
        tried = refusals()
        for _ in range(2):
            assert_ended_once_with_the_same_bits(farm, ask(farm.client, next(_names)), undisturbed)
        # One question to the broker may have been under way when it found out.
        assert refusals() <= tried + 1
        proxy.mend()
        with farm.frozen("worker"):
            assert_ended_once_with_the_same_bits(farm, ask(farm.client, next(_names)), undisturbed)
    finally:
        farm.stop("cut-off")
        proxy.close()


@pytest.mark.parametrize("farm", ["postgresql"], indirect=True)
def test_a_database_without_free_connections_loses_nothing(farm: Farm, undisturbed):
    calibration = ask(farm.client, next(_names))
    wait_until(lambda: _running(farm) != [], "work")
    wait_until(farm.is_ready, "the API's own connection")
    end = time.monotonic() + 3 * LEASE_S
    refused = 0
    with ExitStack() as taken:
        while time.monotonic() < end:
            try:
                taken.callback(psycopg.connect(_libpq(farm.database_url)).close)
            except psycopg.OperationalError:
                refused += 1
                assert farm.is_ready()
                time.sleep(0.1)  # as often as takes what becomes free, and leaves the processors to the farm
    assert refused > 0
    assert_ended_once_with_the_same_bits(farm, calibration, undisturbed)


def _libpq(url: str) -> str:
    parsed = make_url(url)
    return f"host={parsed.query['host']} user={parsed.username} dbname={parsed.database}"


def _answering(farm: Farm) -> str:
    with farm.database.reading() as session:
        return " ".join(worker.name for worker in answering_workers(session) if worker.warm)


def test_ingestion_and_detection_killed_at_work(farm: Farm, walk: Walk):
    farm.use_worker(2)
    vehicle, rig = new_rig(farm.client, walk.rig, next(_names))
    plain = farm.finished(farm.client.recordings.upload(walk.bag, vehicle.id, rig.id, name="plain"))
    assert plain.state == "ready"
    killed = farm.client.recordings.upload(walk.bag, vehicle.id, rig.id, name="killed")
    job_id = farm.kill_who_works_on("ingest")
    killed = farm.finished(killed)
    assert killed.state == "ready"
    assert farm.job(job_id).lost == 1
    assert _sensors(killed) == _sensors(plain)
    wait_until(lambda: _unused_blobs(farm) == 0, "the removal of what the dead worker left")

    one = farm.finished(farm.client.detections.create(plain.id, REGION, detector="tolerant"))
    two = farm.client.detections.create(killed.id, REGION, detector="tolerant")
    job_id = farm.kill_who_works_on("detect")
    two = farm.finished(two)
    for recording in (plain, killed):
        leave_marks_to_people(farm.client, recording.id)
    assert two.state == "done"
    assert farm.job(job_id).lost == 1
    assert one.counts == two.counts
    assert _vertices(farm, one) == _vertices(farm, two)


def _sensors(recording):
    return [sensor.model_dump(exclude={"id", "recording_id"}) for sensor in recording.sensors]


def _vertices(farm: Farm, detection):
    return [(v.sweep_index, v.time_ns, v.x, v.y, v.z) for v in farm.client.detections.vertices(detection.id)]


def _unused_blobs(farm: Farm) -> int:
    """Blobs that are neither stored, nor of a recording that is still there; and files without a row."""
    with farm.database.reading() as session:
        rows = set(session.scalars(select(Blob.key).where(Blob.state == "stored")))
        reserved = session.scalar(select(func.count()).where(Blob.state != "stored")) or 0
        assert session.scalar(select(func.count()).select_from(Recording)) is not None
    blobs = farm.folder / "blobs"
    files = {str(path.relative_to(blobs)) for path in blobs.rglob("*") if path.is_file()}
    return reserved + len(files - rows - {MARKER})
