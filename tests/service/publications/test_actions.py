"""Publications that meet a deletion, the end of a calibration or each other: real transactions at the same moment."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from threading import Barrier
from typing import Any

import pytest
from sqlalchemy import select, update

from service.platform.db.calibrations import Calibration, CalibrationRun, CorrespondenceSet, Publication, Result
from service.platform.jobs.claims import StaleInputError
from service.publications.actions import Grounds, hold_to_publish, publish
from service.recordings.actions import delete_recording
from tests.service.calibrations.test_results import FOUND, NEWER, current_address, failed, seed_results
from tests.service.detections.seeding import seed_recording
from tests.support.concluding import conclusion
from tests.workers.tasks.test_concluding import document, of_block

# Long enough that whoever does not wait is done.
_WAITS_S = 0.5


def of_recording(api, rig):
    """A recording and the result that came from it."""
    recording, _ = seed_recording(api.database, rig, 1)
    calibration, (result,) = seed_results(api, rig, folds=(-1,))
    with api.database.writing() as session:
        of = CorrespondenceSet(
            fleet_id=rig.fleet_id, vehicle_id=rig.vehicle_id, rig_id=rig.id, recording_id=recording, camera="front",
            source="annotations", content_hash=str(recording), count=60, pairs={}, notes=[],
        )  # fmt: skip
        session.add(of)
        session.flush()
        runs = update(CalibrationRun).where(CalibrationRun.calibration_id == calibration)
        session.execute(runs.values(set_id=of.id))
    return recording, result


def meanwhile(pool: ThreadPoolExecutor, act: Callable[..., Any], *given: Any) -> Future[Any]:
    """Begin what has to wait for the transaction that is open here."""
    begun = pool.submit(act, *given)
    with pytest.raises(TimeoutError):
        begun.result(_WAITS_S)
    return begun


def publish_here(session, result_id):
    """As the route does, in a transaction that stays open."""
    result = session.get_one(Result, result_id)
    calibration = hold_to_publish(session, result)
    publish(session, calibration, result, Grounds(None, None))


def post(actor, result_id, body=None):
    return actor.post(f"/results/{result_id}/publication", body)


def test_a_publication_that_waits_for_the_deletion_finds_nothing(api, rig, engineer):
    recording, result = of_recording(api, rig)
    with ThreadPoolExecutor(1) as pool:
        with api.database.writing() as session:
            delete_recording(session, recording, with_published=False)
            waiting = meanwhile(pool, post, engineer, result)
        answer = waiting.result(30)
    assert (answer.status_code, answer.json()["code"]) == (404, "not_found")
    assert engineer.get(current_address(rig)).json()["code"] == "no_calibration_yet"


def test_a_deletion_that_waits_for_the_publication_is_refused_and_nothing_is_lost(api, rig, engineer):
    recording, result = of_recording(api, rig)
    with ThreadPoolExecutor(1) as pool:
        with api.database.writing() as session:
            publish_here(session, result)
            waiting = meanwhile(pool, engineer.delete, f"/recordings/{recording}")
        answer = waiting.result(30)
    assert (answer.status_code, answer.json()["code"]) == (409, "calibration_in_use")
    assert engineer.get(current_address(rig)).json()["result_id"] == str(result)


def unended(api, rig, held_out_px):
    """A calibration whose runs are all done, to be ended and published."""
    calibration, results = seed_results(api, rig, folds=(-1, 0, 1))
    with api.database.writing() as session:
        for n, result in enumerate(
            session.scalars(select(Result).where(Result.id.in_(results)).order_by(Result.fold))
        ):
            held = [] if n == 0 else [held_out_px] * 5
            heldout = of_block(held, [5 * n + i for i in range(len(held))]) if held else None
            result.document = result.document | document(held_out_px) | {"heldout": heldout}
        session.execute(
            update(Calibration)
            .where(Calibration.id == calibration)
            .values(state="running", summary=None, publish="recommended")
        )
    return calibration


def end(context, write):
    with context.database.writing() as session:
        write(session)


def end_if_unchanged(context, write):
    """As the job does, which judges again otherwise."""
    with suppress(StaleInputError):
        end(context, write)


def test_a_person_who_waits_for_the_end_of_a_calibration_is_asked_about_its_result(api, rig, engineer, context):
    calibration = unended(api, rig, 0.9)
    write = conclusion(context, calibration)
    _, (worse,) = seed_results(api, rig, folds=(-1,), found=FOUND | {"heldout_mean_px": 3.0})
    with ThreadPoolExecutor(1) as pool:
        with api.database.writing() as session:
            write(session)
            waiting = meanwhile(pool, post, engineer, worse)
        answer = waiting.result(30)
    # It was judged before that: a person is told, and the click of one who had not seen it still publishes.
    assert answer.json()["override"]["sentences"] == [NEWER]
    _, by_itself = engineer.get(f"/vehicles/{rig.vehicle_id}/cameras/front/publications").json()["items"]
    assert (by_itself["calibration_id"], by_itself["override"]) == (str(calibration), None)
    assert by_itself["reason"] == "It was recommended and passed its checks."


def test_the_end_of_a_calibration_that_waits_for_a_person_sees_what_they_published(api, rig, engineer, context):
    calibration = unended(api, rig, 3.0)
    write = conclusion(context, calibration)
    _, (better,) = seed_results(api, rig, folds=(-1,))
    with ThreadPoolExecutor(1) as pool:
        with api.database.writing() as session:
            publish_here(session, better)
            waiting = meanwhile(pool, end, context, write)
        with pytest.raises(StaleInputError):
            waiting.result(30)
    end(context, conclusion(context, calibration))
    front = engineer.get(f"/calibrations/{calibration}").json()["summary"]["cameras"]["front"]
    assert front["published"] is False
    (sentence,) = failed(front)
    assert "Held-out pairs lie 3.00 px off, in the vehicle's current calibration 0.90." in sentence
    assert engineer.get(current_address(rig)).json()["result_id"] == str(better)


def test_all_at_once_nobody_fails_and_nothing_dangles(api, rig, engineer, context):
    """Two people, a calibration that ends and a deletion, let go at the same moment, five times."""
    for _ in range(5):
        (recording, mine), (_, (theirs,)) = of_recording(api, rig), seed_results(api, rig, folds=(-1,))
        write = conclusion(context, unended(api, rig, 0.9))
        barrier = Barrier(4)

        def at_once(act, *given, barrier=barrier):
            barrier.wait(120)
            return act(*given)

        with ThreadPoolExecutor(4) as pool:
            ending = pool.submit(at_once, end_if_unchanged, context, write)
            asked = [
                pool.submit(at_once, post, engineer, mine, {"override": {"reason": "Mine."}}),
                pool.submit(at_once, post, engineer, theirs, {"override": {"reason": "Theirs."}}),
                pool.submit(at_once, engineer.delete, f"/recordings/{recording}"),
            ]
            ending.result(60)
            published, other, deleted = [one.result(60) for one in asked]
        assert other.status_code == 201, other.text
        # Mine was published and kept, published and then replaced and deleted, or gone before.
        assert (published.status_code, deleted.status_code) in ((201, 409), (201, 204), (404, 204))
        _check(api, engineer, rig, mine, kept=deleted.status_code == 409)


def _check(api, engineer, rig, mine, *, kept):
    rows = engineer.get(f"/vehicles/{rig.vehicle_id}/cameras/front/publications").json()["items"]
    assert [row["is_current"] for row in rows] == [True, *[False] * (len(rows) - 1)]
    assert engineer.get(current_address(rig)).json()["publication_id"] == rows[0]["id"]
    assert (str(mine) in [row["result_id"] for row in rows]) is kept
    with api.database.reading() as session:
        numbers = session.scalars(select(Publication.number).order_by(Publication.number.desc())).all()
    assert len(set(numbers)) == len(rows) and None not in numbers
