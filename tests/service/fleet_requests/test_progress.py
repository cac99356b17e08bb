"""A fleet request from its first job to its end: failures, cancel, retry, and finishes at the same moment."""

import threading
from concurrent.futures import ThreadPoolExecutor
from uuid import UUID

import pytest
from sqlalchemy import event, func, select, update

from service.calibration_runs.actions import end_calibrations
from service.fleet_requests import actions
from service.fleet_requests.actions import ask_all_to_end, retry_failed
from service.platform.db.clock import now
from service.platform.db.models import (
    Calibration,
    CalibrationRun,
    CorrespondenceSet,
    Fleet,
    FleetRequest,
    FleetRequestVehicle,
    Job,
    Recording,
    Rig,
)
from service.platform.jobs.claims import claim, finishing
from service.platform.jobs.reaper import reap
from service.recordings.actions import delete_recording
from service.recordings.retention import delete_old_imports
from tests.service.platform.jobs.support import statements
from tests.support.databases import wait_until_one_waits
from tests.support.work import lose_every_worker, work
from workers.tasks.running import run_job

from .conftest import Vans


def job_of(context, van) -> int:
    with context.database.reading() as session:
        return session.scalars(
            select(Job.id)
            .join(CalibrationRun, CalibrationRun.id == Job.subject_id)
            .join(Calibration, Calibration.id == CalibrationRun.calibration_id)
            .where(Calibration.vehicle_id == UUID(van["vehicle"]))
            .order_by(Job.id.desc())
        ).first()


def counts(request) -> dict[str, int]:
    return {name: count for name, count in request["counts"].items() if count}


def test_one_vehicle_may_fail_be_skipped_or_be_retried_and_the_rest_is_done(vans: Vans, context):
    made = {f"van {n}": vans.add(f"van {n}") for n in range(5)} | {"none": vans.add("none", None)}
    asked = vans.ask().json()
    etag = vans.engineer.get(f"/fleet-requests/{asked['id']}").headers["ETag"]
    same = vans.engineer.get(f"/fleet-requests/{asked['id']}", headers={"If-None-Match": etag})
    assert same.status_code == 304
    held = claim(context.database, job_of(context, made["van 1"]), "somebody")
    assert counts(vans.read(asked)) == {"matched": 6, "queued": 4, "running": 1, "skipped": 1}
    assert vans.states(asked, state="running") == {"van 1": "running"}
    with context.database.writing() as session:
        session.execute(update(Job).where(Job.id == held.job_id).values(state="queued"))
    lose_every_worker(context.database, job_of(context, made["van 3"]))
    reap(context.database, context.store)
    seen = vans.read(asked)
    assert counts(seen) == {"matched": 6, "queued": 4, "failed": 1, "skipped": 1} and seen["state"] == "running"
    work(context)
    ended = vans.read(asked)
    assert counts(ended) == {"matched": 6, "done": 4, "failed": 1, "skipped": 1}
    assert (ended["state"], ended["progress"]["fraction"]) == ("done_with_failures", 1.0)
    assert ended["finished_at"] is not None and ended["seconds_left"] is None
    failed = vans.engineer.get(f"/fleet-requests/{asked['id']}/vehicles", params={"state": "failed"}).json()["items"]
    assert [(item["vehicle"], item["problem"]["code"]) for item in failed] == [("van 3", "worker_lost")]
    again = vans.engineer.post(f"/fleet-requests/{asked['id']}/retry")
    assert again.status_code == 202 and counts(again.json()) == {"matched": 6, "queued": 1, "done": 4, "skipped": 1}
    twice = vans.engineer.post(f"/fleet-requests/{asked['id']}/retry").json()
    assert counts(twice) == counts(again.json()), "a second retry finds nothing failed"
    work(context)
    healed = vans.read(asked)
    assert (healed["state"], counts(healed)) == ("done", {"matched": 6, "done": 5, "skipped": 1})
    items = vans.engineer.get(f"/fleet-requests/{asked['id']}/vehicles", params={"state": "done"}).json()["items"]
    assert {item["vehicle"]: item["cameras"]["front"]["model"] for item in items} == dict.fromkeys(
        [f"van {n}" for n in range(5)], "pinhole"
    )


def test_a_cancelled_request_keeps_what_is_done_and_ends_the_rest(api, vans: Vans, context):
    made = [vans.add(f"van {n}") for n in range(4)]
    asked = vans.ask().json()
    run_job(context, job_of(context, made[0]))
    running = claim(context.database, job_of(context, made[1]), "somebody")
    with statements(api.database) as said:
        answer = vans.engineer.post(f"/fleet-requests/{asked['id']}/cancel")
    assert answer.status_code == 202 and answer.json()["cancel_requested"]
    reap(context.database, context.store)
    assert counts(vans.read(asked)) == {"matched": 4, "running": 1, "done": 1, "cancelled": 2}
    with finishing(context.database, running, "cancelled"):
        pass
    ended = vans.read(asked)
    assert (ended["state"], counts(ended)) == ("cancelled", {"matched": 4, "done": 1, "cancelled": 3})
    before = vans.engineer.post(f"/fleet-requests/{asked['id']}/cancel").json()
    assert (before["state"], counts(before)) == ("cancelled", counts(ended)), "what has ended stays as it is"
    again = vans.engineer.post(f"/fleet-requests/{asked['id']}/retry").json()
    assert counts(again) == {"matched": 4, "done": 1, "queued": 3}, "cancelled vehicles can be calibrated after all"
    one = vans.ask({"name": "van 0"}).json()
    with statements(api.database) as alone:
        vans.engineer.post(f"/fleet-requests/{one['id']}/cancel")
    assert alone == said, "one vehicle takes as many as three, and as a thousand"


def test_vehicles_that_end_at_the_same_moment_are_each_counted_once(vans: Vans, context):
    made = [vans.add(f"van {n}", 12) for n in range(6)]
    asked = vans.ask().json()
    held = [claim(context.database, job_of(context, van), f"w{n}") for n, van in enumerate(made)]
    barrier = threading.Barrier(len(held) + 1)

    def finish(mine) -> None:
        barrier.wait()
        with finishing(context.database, mine, "failed", {"code": "x"}):
            pass

    threads = [threading.Thread(target=finish, args=(mine,)) for mine in held]
    for thread in threads:
        thread.start()
    barrier.wait()
    vans.engineer.post(f"/fleet-requests/{asked['id']}/cancel")
    for thread in threads:
        thread.join()
    ended = vans.read(asked)
    assert (ended["state"], counts(ended)) == ("done_with_failures", {"matched": 6, "failed": 6})


def test_a_vehicle_whose_recording_is_deleted_waits_for_nothing(vans: Vans, context):
    vans.add("van")
    asked = vans.ask().json()
    with context.database.writing() as session:
        (calibration,) = session.scalars(select(Calibration)).all()
        end_calibrations(session, [calibration.id], "cancelled", {"code": "recording_deleted"})
        session.delete(calibration)
    ended = vans.read(asked)
    assert (ended["state"], counts(ended)) == ("done_with_failures", {"matched": 1, "cancelled": 1})
    with context.database.reading() as session:
        row = session.scalars(select(FleetRequestVehicle)).one()
        assert (row.problem["code"], row.calibration_id) == ("recording_deleted", None)


@pytest.mark.parametrize("database_url", ["postgresql"], indirect=True)
def test_a_cancel_beside_a_retry_also_ends_what_the_retry_began(vans: Vans, context):
    """SQLite has one writer, so there a cancel never sees half a retry."""
    van = vans.add("van")
    vans.add("other")
    asked = vans.ask().json()
    lose_every_worker(context.database, job_of(context, van))
    reap(context.database, context.store)

    def cancel() -> None:
        with context.database.writing() as session:
            ask_all_to_end(session, session.get_one(FleetRequest, UUID(asked["id"])))

    cancelling = threading.Thread(target=cancel)
    with context.database.writing() as session:
        row = session.get_one(FleetRequest, UUID(asked["id"]))
        retry_failed(session, row)
        session.flush()
        cancelling.start()
        wait_until_one_waits(context.database)
    cancelling.join()
    reap(context.database, context.store)
    ended = vans.read(asked)
    assert (ended["state"], counts(ended)) == ("cancelled", {"matched": 2, "cancelled": 2})


@pytest.mark.parametrize("database_url", ["postgresql"], indirect=True)
def test_a_recording_is_deleted_beside_a_retry_of_its_vehicle(vans: Vans, context, monkeypatch):
    """Each holds rows that the other wants; in another order PostgreSQL would end one of them."""
    van = vans.add("van")
    vans.add("other")
    asked = vans.ask().json()
    lose_every_worker(context.database, job_of(context, van))
    reap(context.database, context.store)
    with context.database.writing() as session:
        rig = session.get_one(Rig, UUID(van["rig"]))
        of = {"fleet_id": rig.fleet_id, "vehicle_id": rig.vehicle_id, "rig_id": rig.id}
        session.add(recording := Recording(**of, name="walk", file_name="walk.bag", state="ready"))
        session.flush()
        session.get_one(CorrespondenceSet, UUID(van["set"])).recording_id = recording.id

    def delete() -> None:
        with context.database.writing() as session:
            delete_recording(session, recording.id, with_published=True)

    plan = actions.plan_vehicles
    with ThreadPoolExecutor() as pool, context.database.writing() as session:

        def plan_while_one_deletes(*given):
            deleting.append(pool.submit(delete))
            wait_until_one_waits(context.database)
            return plan(*given)

        deleting = []
        monkeypatch.setattr(actions, "plan_vehicles", plan_while_one_deletes)
        retry_failed(session, session.get_one(FleetRequest, UUID(asked["id"])))
        session.commit()
        deleting[0].result(timeout=120)
    assert vans.states(asked) == {"van": "cancelled", "other": "queued"}


@pytest.mark.parametrize("database_url", ["postgresql"], indirect=True)
def test_old_pairs_that_a_retry_calibrates_again_stay(vans: Vans, context, monkeypatch, caplog):
    """The round of retention holds the pairs, the retry the vehicle: in one order neither waits for the other."""
    van = vans.add("van")
    asked = vans.ask().json()
    lose_every_worker(context.database, job_of(context, van))
    reap(context.database, context.store)
    with context.database.writing() as session:
        session.execute(update(Fleet).values(retention={"pairs": 30}))
        for table in (CorrespondenceSet, CalibrationRun):
            session.execute(update(table).values(created_at=now(-40 * 86400.0)))
    plan = actions.plan_vehicles
    with ThreadPoolExecutor() as pool, context.database.writing() as session:

        def plan_while_a_round_goes(*given):
            rounds.append(pool.submit(delete_old_imports, context.database))
            wait_until_one_waits(context.database)
            return plan(*given)

        rounds = []
        monkeypatch.setattr(actions, "plan_vehicles", plan_while_a_round_goes)
        retry_failed(session, session.get_one(FleetRequest, UUID(asked["id"])))
        session.commit()
        assert rounds[0].result(timeout=120) == 0 and "next round" not in caplog.text
    assert vans.states(asked) == {"van": "queued"}


def test_a_large_request_is_made_in_parts_between_which_others_write(api, vans: Vans, context, monkeypatch):
    """Whoever asks waits for the first part alone; a cancel ends what no part has made yet."""
    monkeypatch.setattr(actions, "_PART", 2)
    monkeypatch.setattr("service.app.make_parts", lambda database: None)  # this test goes on by itself
    for n in range(7):
        vans.add(f"van {n}", 40 if n != 5 else None)
    transactions: list[int] = []
    event.listen(api.database.engine, "commit", lambda _: transactions.append(1))

    def made() -> int:
        with api.database.reading() as session:
            return session.scalar(select(func.count()).select_from(Calibration)) or 0

    asked = vans.ask({"name": "van *"}, headers={"X-Request-ID": "who-asked"}).json()
    assert (asked["counts"]["queued"], made()) == (7, 2)
    before = len(transactions)
    actions.make_parts(api.database)
    assert made() == 6 and len(transactions) - before >= 3, "each part commits by itself"
    assert vans.read(asked)["counts"]["skipped"] == 1
    with api.database.reading() as session:
        assert set(session.scalars(select(Job.request_id))) == {"who-asked"}
    second = vans.ask({"vehicle_ids": [v["vehicle_id"] for v in _items(vans, asked)]}).json()
    assert second["asked"]["vehicles"]["named"] == 7 and "vehicle_ids" not in second["asked"]["vehicles"]
    vans.engineer.post(f"/fleet-requests/{second['id']}/cancel")
    reap(context.database, context.store)
    reap(context.database, context.store)
    ended = vans.read(second)
    assert (ended["state"], ended["counts"]["cancelled"], made()) == ("cancelled", 7, 8)


@pytest.mark.parametrize("database_url", ["postgresql"], indirect=True)
def test_services_that_plan_one_request_at_once_share_its_vehicles(api, vans: Vans, monkeypatch):
    monkeypatch.setattr(actions, "_PART", 1)
    monkeypatch.setattr("service.app.make_parts", lambda database: None)  # this test goes on by itself
    for n in range(61):
        vans.add(f"van {n}", 40)
    vans.ask({"name": "van *"})
    planned: list[str] = []
    plan, both = actions.plan_vehicles, threading.Barrier(2)

    def plan_beside_another(session, template, chosen):
        planned.extend(each.name for each in chosen)
        return plan(session, template, chosen)

    def go_on():
        both.wait()
        actions.make_parts(api.database)

    monkeypatch.setattr(actions, "plan_vehicles", plan_beside_another)
    with ThreadPoolExecutor() as pool:
        for done in [pool.submit(go_on) for _ in range(2)]:
            done.result(timeout=120)
    with api.database.reading() as session:
        assert session.scalar(select(func.count()).select_from(Calibration)) == 61
    assert len(planned) < 96, "not each vehicle twice"


def _items(vans: Vans, asked):
    return vans.engineer.get(f"/fleet-requests/{asked['id']}/vehicles").json()["items"]
