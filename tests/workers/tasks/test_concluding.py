"""What a calibration ends as, and what of it a vehicle is given."""

from uuid import UUID

import numpy as np
import pytest
from sqlalchemy import select, update

from apexcal.geometry.se3 import SE3, to_document
from service.calibration_runs.actions import end_runs
from service.platform.db.models import (
    Calibration,
    CalibrationRun,
    CorrespondenceSet,
    Fleet,
    Job,
    Publication,
    Result,
)
from service.platform.jobs.claims import Lease, StaleInputError, claim, finish, finishing
from service.platform.jobs.kinds import CannotRetryError, kind_of
from tests.service.platform.jobs.support import make_calibration, statements
from tests.support.results import fit_result, model_summary, of_block, summary
from tests.support.rows import add
from tests.support.work import work
from workers.tasks.concluding import conclude

MOUNT = {"to_frame": "camera", "from_frame": "velodyne"}


def document(mean_px, heldout=(), model="pinhole", **more):
    held = of_block(heldout, range(len(heldout))) if heldout else None
    return fit_result(model, mean_px, transform=to_document(SE3("camera", "velodyne")), heldout=held, **more)


def check(verdict, sentence="The marks lie off.", scope="mount_with_lens"):
    of = {"name": "made", "title": "Made", "remedy": "" if verdict == "pass" else "Look.", "figures": {}}
    return of | {"verdict": verdict, "sentence": sentence, "scope": scope}


def failed(front):
    """The sentences of the checks that a camera's recommended result does not pass."""
    return [one["sentence"] for one in front["checks"] if one["verdict"] in ("look", "stop")]


def end(context, run_id, state="done", found=None):
    with context.database.writing() as session:
        run = session.get_one(CalibrationRun, run_id)
        if found:
            of_run = {name: getattr(run, name) for name in ("fleet_id", "calibration_id", "camera", "model", "fold")}
            session.add(Result(**of_run, run_id=run.id, document=found))
        session.flush()
        end_runs(session, [run.id], state)


@pytest.fixture
def three_runs(context):
    """Full fits of two models, and one fold of the first."""
    calibration_id, runs = make_calibration(context.database, models=("pinhole", "brown_conrady", "kannala_brandt"))
    with context.database.writing() as session:
        session.get_one(Calibration, calibration_id).publish = "recommended"
        session.execute(update(CalibrationRun).where(CalibrationRun.id == runs[2]).values(model="pinhole", fold=0))
    return calibration_id, runs


def ended(context, calibration_id):
    """The end of the calibration, once a worker has done what is queued."""
    work(context)
    with context.database.reading() as session:
        row = session.get_one(Calibration, calibration_id)
        return row.state, row.summary, session.scalars(select(Publication.result_id)).all()


def concluding(context):
    """The job that concludes, claimed."""
    with context.database.reading() as session:
        (job_id,) = session.scalars(select(Job.id).where(Job.kind == "conclude"))
    return claim(context.database, job_id, "w")


@pytest.mark.parametrize("state", ["cancelled", "failed"])
def test_a_calibration_that_was_cancelled_or_whose_fits_all_failed_ends_at_once_without_a_summary(
    context, three_runs, state
):
    calibration_id, (pinhole, brown, fold) = three_runs
    if state == "failed":
        end(context, pinhole, "failed")
        end(context, brown, "failed")
        end(context, fold, found=document(5.0, [5.0]))
    else:
        end(context, pinhole, found=document(5.0))
        end(context, brown, found=document(1.0, model="brown_conrady"))
        end(context, fold, "cancelled")
    with context.database.reading() as session:
        row = session.get_one(Calibration, calibration_id)
        assert (row.state, row.summary) == (state, None) and row.finished_at is not None
        assert session.scalars(select(Job)).all() == [] and session.scalars(select(Publication)).all() == []


def test_a_conclusion_that_failed_fails_its_calibration_and_is_retried(context, three_runs):
    calibration_id, (pinhole, brown, fold) = three_runs
    end(context, pinhole, found=document(5.0))
    end(context, brown, "failed")
    end(context, fold, found=document(5.0, [5.0] * 10))
    problem = {"code": "worker_lost", "detail": "Every worker that tried it died.", "hint": "Tell the operator."}
    held = concluding(context)
    with finishing(context.database, held, "failed", problem):
        pass
    with context.database.reading() as session:
        row, job = session.get_one(Calibration, calibration_id), session.get_one(Job, held.job_id)
        assert (row.state, row.problem, row.summary) == ("failed", problem, None)
    with context.database.writing() as session:
        kind_of("conclude").retry(session, job)
    state, summary, _ = ended(context, calibration_id)
    assert state == "done" and list(summary["cameras"]["front"]["models"]) == ["pinhole"]
    with context.database.writing() as session, pytest.raises(CannotRetryError, match="no longer failed"):
        kind_of("conclude").retry(session, job)


def test_a_conclusion_from_before_a_retry_of_a_run_is_made_again(context):
    calibration_id, (run_id,) = make_calibration(context.database)
    end(context, run_id, found=document(1.0))
    held = concluding(context)
    with Lease(context.database, held) as lease:
        write = conclude(context, held, lease)
        with context.database.writing() as session:
            session.get_one(Calibration, calibration_id).reopened += 1
        with pytest.raises(StaleInputError):
            finish(context.database, held, write)
        finish(context.database, held, conclude(context, held, lease))
    assert ended(context, calibration_id)[0] == "done"


def test_the_transaction_that_ends_a_calibration_is_short(context):
    """It reads no results: those were read before it."""
    calibration_id, (run_id,) = make_calibration(context.database)
    end(context, run_id, found=document(1.0))
    held = concluding(context)
    with Lease(context.database, held) as lease:
        hand_over = conclude(context, held, lease)
    take = kind_of("conclude").take
    with context.database.writing() as session, statements(context.database) as seen:
        take(session, calibration_id, hand_over(session))
        session.flush()
    # The calibration, locked; the vehicle, locked; the results' checks; the recommended result and its checks of now
    # (its origin, the current one, withdrawals, the rig's LiDAR; no sensors, as that states no serial number); the
    # end, and the fleet request.
    assert seen == ["SELECT", "SELECT", "UPDATE", *["SELECT"] * 5, "UPDATE", "UPDATE"]


def two_models(context, *, folds=2):
    """Full fits of two models and their folds, to be published where recommended: (calibration, run ids by model)."""
    names = ["pinhole", "brown_conrady"]
    calibration_id, runs = make_calibration(context.database, models=[*names, *(f"{i}" for i in range(2 * folds))])
    by_model = {name: [run] for name, run in zip(names, runs, strict=False)}
    with context.database.writing() as session:
        session.get_one(Calibration, calibration_id).publish = "recommended"
        for place, run_id in enumerate(runs[2:]):
            model, fold = names[place % 2], place // 2
            session.execute(update(CalibrationRun).where(CalibrationRun.id == run_id).values(model=model, fold=fold))
            by_model[model].append(run_id)
    return calibration_id, by_model


def end_model(context, runs, mean_px, model, **more):
    """Its fit to all pairs, and in each fold 10 pairs whose errors lie a little about the mean."""
    end(context, runs[0], found=document(mean_px, model=model, **more))
    for fold, run_id in enumerate(runs[1:]):
        errors = [mean_px + 0.01 * (pair % 2) + 0.01 * fold for pair in range(10)]
        found = document(mean_px, model=model)
        end(context, run_id, found=found | {"heldout": of_block(errors, range_of(fold))})


def range_of(fold, count=10):
    return list(range(count * fold, count * fold + count))


@pytest.mark.parametrize(("folds", "given"), [(2, 1), (0, 0)])
def test_the_lowest_error_is_recommended_and_published_where_pairs_were_held_out(context, folds, given):
    calibration_id, runs = two_models(context, folds=folds)
    end_model(context, runs["pinhole"], 5.0, "pinhole")
    end_model(context, runs["brown_conrady"], 1.0, "brown_conrady")
    state, summary, published = ended(context, calibration_id)
    front = summary["cameras"]["front"]
    assert (state, front["recommended"]) == ("done", "brown_conrady")
    assert len(published) == given
    assert front["published"] is bool(given)
    assert failed(front) == ([] if given else ["No pairs were held out."])


@pytest.mark.parametrize(
    ("checks", "policy", "is_published", "verdicts"),
    [
        ([check("pass")], {}, True, ("pass", "pass")),
        # Held-out pairs lie 1.01 px off.
        ([check("pass")], {"heldout_mean_px": 1.1}, True, ("pass", "pass")),
        ([check("pass")], {"heldout_mean_px": 0.9}, False, ("pass", "pass")),
        ([check("look")], {}, False, ("look", "look")),
        ([check("look")], {"publish_looks": True}, True, ("look", "look")),
        ([check("stop")], {"publish_looks": True}, False, ("stop", "stop")),
        # Who uses the mount with its own lens is not concerned.
        ([check("stop", scope="mount_alone")], {}, True, ("pass", "stop")),
        # What was not checked is no doubt, unless the policy requires it.
        ([check("not_checked") | {"name": "clock"}], {}, True, ("pass", "pass")),
        ([check("not_checked") | {"name": "clock"}], {"required_checks": ["clock"]}, False, ("pass", "pass")),
        ([check("pass") | {"name": "clock"}], {"required_checks": ["clock"]}, True, ("pass", "pass")),
    ],
)
def test_what_is_published_by_itself_follows_from_the_checks_and_the_policy(
    context, checks, policy, is_published, verdicts
):
    calibration_id, runs = two_models(context)
    with context.database.writing() as session:
        session.execute(update(Fleet).values(policy=policy))
    end_model(context, runs["pinhole"], 5.0, "pinhole")
    end_model(context, runs["brown_conrady"], 1.0, "brown_conrady", checks=checks)
    _, summary, published = ended(context, calibration_id)
    front = summary["cameras"]["front"]
    model = front["models"]["brown_conrady"]
    assert (model["verdict"], model["verdict_alone"]) == verdicts
    assert (len(published), front["published"]) == (int(is_published), is_published)
    with context.database.reading() as session:
        stored = session.get_one(Result, UUID(model["result_id"]))
        assert stored.verdict == verdicts[0] and "models" in {one["name"] for one in stored.checks}
        overridden = session.scalars(select(Publication.overridden)).all()
    assert not is_published or overridden == [["The marks lie off."] if verdicts[0] == "look" else None]


def test_each_result_is_judged_also_where_nobody_asked_to_publish(context):
    calibration_id, runs = two_models(context)
    with context.database.writing() as session:
        session.get_one(Calibration, calibration_id).publish = "none"
    end_model(context, runs["pinhole"], 5.0, "pinhole")
    end_model(context, runs["brown_conrady"], 1.0, "brown_conrady", checks=[check("look")])
    _, summary, published = ended(context, calibration_id)
    front = summary["cameras"]["front"]
    assert published == [] and front["published"] is None
    # Pinhole is far behind on held-out pairs.
    verdicts = {"brown_conrady": "look", "pinhole": "stop"}
    assert {name: model["verdict"] for name, model in front["models"].items()} == verdicts
    assert failed(front) == ["The marks lie off."]


def test_a_calibration_published_meanwhile_has_the_result_judged_beside_it(context):
    """The current result changes between the judging and the commit: the job judges again, and once."""
    calibration_id, runs = two_models(context)
    end_model(context, runs["pinhole"], 5.0, "pinhole")
    end_model(context, runs["brown_conrady"], 1.0, "brown_conrady")
    held = concluding(context)
    with Lease(context.database, held) as lease:
        write = conclude(context, held, lease)
        another = give(context, runs["pinhole"][0], 0.6)
        with pytest.raises(StaleInputError):
            finish(context.database, held, write)
        finish(context.database, held, conclude(context, held, lease))
    _, summary, published = ended(context, calibration_id)
    assert published == [another]
    (sentence,) = failed(summary["cameras"]["front"])
    assert "in the vehicle's current calibration 0.60." in sentence
    with context.database.reading() as session:
        results = session.scalars(select(Result).where(Result.verdict.is_not(None), Result.id != another)).all()
        assert {one.compared_with for one in results} == {another}


TURNS, SHIFTS = ("rotation_x", "rotation_y", "rotation_z"), ("t_x", "t_y", "t_z")
DEVIATIONS = dict.fromkeys(TURNS, 0.05) | dict.fromkeys(SHIFTS, 0.005)  # degrees, metres
STATED = {
    "std": DEVIATIONS,
    "covariance": {
        "names": list(DEVIATIONS),
        "units": [*["deg"] * 3, *["m"] * 3],
        "matrix": [[(a == b) * DEVIATIONS[a] ** 2 for b in DEVIATIONS] for a in DEVIATIONS],
    },
}


def test_a_result_states_what_is_published_of_it(context):
    """Two models predict alike, 0.1 m apart: deviations, interval, prediction and the mount's check count both."""
    calibration_id, runs = two_models(context)
    point = {"u": 640.0, "v": 480.0, "stated_px": [0.1], "stated_mm": [2.0]}
    stated = STATED | {
        "interval95_half_width": {name: 2.0 * std for name, std in DEVIATIONS.items()},
        "prediction": {"distances_m": [20.0], "expected_over_stated": 1.0, "points": [point]},
        "checks": [check("pass", scope="mount_alone") | {"name": "mount_alone"}],
    }
    for model, t_x in (("pinhole", 0.0), ("brown_conrady", 0.1)):
        mount = to_document(SE3("camera", "velodyne", t=np.array([t_x, 0.0, 0.0])))
        end(context, runs[model][0], found=document(1.0, model=model) | stated | {"transform": mount})
        for fold, run_id in enumerate(runs[model][1:]):
            end(context, run_id, found=document(1.0, model=model) | {"heldout": of_block([1.0] * 10, range_of(fold))})
    ended(context, calibration_id)
    with context.database.reading() as session:
        result = session.scalars(select(Result).where(Result.run_id == runs["pinhole"][0])).one()
        published, half_width_m = result.published, result.published.interval95_half_width["t_x"]
        assert (half_width_m > 0.1, result.fit.interval95_half_width["t_x"]) == (True, 0.01)
        assert published.std["t_x"] == pytest.approx(np.hypot(0.005, np.sqrt(0.5) * 0.1))
        expected_mm = np.hypot(2.0, np.sqrt(0.5) * 100.0)
        assert result.error_20m_mm == published.prediction.points[0].stated_mm[0] == pytest.approx(expected_mm)
        (alone,) = (one for one in result.stored_checks if one.name == "mount_alone")
        assert (alone.verdict, alone.figures["half_width_mm"]) == ("stop", pytest.approx(1e3 * half_width_m))
        (fold,) = session.scalars(select(Result).where(Result.run_id == runs["pinhole"][1])).all()
        assert fold.published_document == fold.document


def give_marked(context, of_run, number, machine, off_m=0.0):
    """An earlier result whose pairs had so many machine marks, given to the camera by its move of this number."""
    mount = to_document(SE3("camera", "velodyne", t=np.array([off_m, 0.0, 0.0])))
    with context.database.writing() as session:
        given = session.get_one(Result, give(context, of_run, 1.2, number))
        given.document = document(1.2) | STATED | {"transform": mount}
        marks = {"name": "marks_confirmed", "figures": {"machine": machine}}
        given.checks = [check("pass") | marks]


@pytest.mark.parametrize(
    ("policy", "earlier", "is_published"),
    [
        ({}, [], False),
        ({"publish_looks": True}, [], False),
        ({"publish_unattended": True}, [], True),
        ({}, [(0.0, 0.0)], True),
        ({}, [(0.0, 0.004)], True),
        ({"publish_looks": True}, [(0.0, 0.1)], False),
        ({}, [(60.0, 0.0)], False),
        ({}, [(0.0, 0.0), (60.0, 0.0)], True),
        ({}, [(0.0, 0.0), None], False),
        ({}, [(0.0, 0.0), None, (60.0, 0.0)], False),
    ],
    ids=[
        "nobody looked", "the policy for looks does not count", "the policy allows it", "people's result agrees",
        "within what both state", "people's result differs", "the earlier one was unattended, too",
        "the one before was people's", "people's was withdrawn", "people's was withdrawn before another",
    ],
)  # fmt: skip
def test_a_result_of_the_machines_marks_alone_publishes_itself_only_where_something_vouches_for_it(
    context, policy, earlier, is_published
):
    """`earlier`: moves of the alias, each with its machine marks and how far it is off; None withdraws."""
    calibration_id, runs = two_models(context)
    with context.database.writing() as session:
        session.execute(update(Fleet).values(policy=policy))
        pairs = session.query(CorrespondenceSet).one()
        pairs.pairs = pairs.pairs | {"machine": [True] * 60}
        owner = session.get_one(Calibration, calibration_id)
        of_vehicle = {"fleet_id": owner.fleet_id, "vehicle_id": owner.vehicle_id, "camera": "front"}
    for number, move in enumerate(earlier, start=1):
        if move is not None:
            give_marked(context, runs["pinhole"][0], number, *move)
            continue
        with context.database.writing() as session:
            session.add(Publication(**of_vehicle, alias="current", number=number))
    end_model(context, runs["pinhole"], 1.0, "pinhole", **STATED)
    end_model(context, runs["brown_conrady"], 5.0, "brown_conrady", **STATED)
    _, summary, _ = ended(context, calibration_id)
    front = summary["cameras"]["front"]
    (marks,) = (one for one in front["checks"] if one["name"] == "marks_confirmed")
    assert marks["sentence"].startswith("Nobody looked at 60 of 60 marks")
    assert (front["published"], marks["verdict"]) == (is_published, "pass" if is_published else "look")


def give(context, of_run, before_px, number=1):
    """Another calibration's result, judged sound and published for the run's vehicle; its id."""
    with context.database.writing() as session:
        run = session.get_one(CalibrationRun, of_run)
        calibration = session.get_one(Calibration, run.calibration_id)
        of_vehicle = {"fleet_id": calibration.fleet_id, "vehicle_id": calibration.vehicle_id}
        had = summary({"pinhole": model_summary(of_run, heldout_mean_px=before_px)})
        before = add(
            session, Calibration, rig_id=calibration.rig_id, content_hash=f"{number}", summary=had, **of_vehicle
        )
        of_before = add(session, CalibrationRun, before, set_id=run.set_id, state="done")
        given = add(session, Result, of_before, document=document(before_px), checks=[], verdict="pass")
        move = {"number": number, "result_id": given.id, "led_to": given.id}
        add(session, Publication, **move, **of_vehicle)
        return given.id


@pytest.mark.parametrize(
    ("before_px", "verdict", "takes_over"), [(1.2, "pass", True), (0.6, "pass", False), (0.6, "stop", True)]
)
def test_a_result_that_predicts_worse_than_a_sound_current_one_does_not_publish_itself(
    context, before_px, verdict, takes_over
):
    calibration_id, runs = two_models(context)
    before = give(context, runs["pinhole"][0], before_px)
    with context.database.writing() as session:
        session.get_one(Result, before).verdict = verdict
    end_model(context, runs["pinhole"], 5.0, "pinhole")
    end_model(context, runs["brown_conrady"], 1.0, "brown_conrady")
    _, summary, _ = ended(context, calibration_id)
    front = summary["cameras"]["front"]
    assert front["published"] is takes_over
    assert takes_over or failed(front)[0].endswith("lie 1.01 px off, in the vehicle's current calibration 0.60.")
