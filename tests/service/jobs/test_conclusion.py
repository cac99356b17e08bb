"""What a calibration ends as, and what of it a vehicle is given."""

import pytest
from sqlalchemy import select, update

from service.db.models import Calibration, CalibrationRun, Publication, Result
from service.jobs.solving import end_run

from .support import make_calibration


def document(mean_px, heldout=()):
    stage = {"mean_px": mean_px, "rms_px": mean_px}
    return {
        "ga": stage,
        "polished": stage,
        "baseline": stage,
        "status": "ok",
        "pairs": 20,
        "iterations": 1,
        "stopped": "converged",
        "alarms": [],
        "heldout": {"errors_px": list(heldout)},
    }


def end(database, run_id, state="done", found=None):
    with database.writing() as session:
        run = session.get_one(CalibrationRun, run_id)
        if found:
            session.add(
                Result(
                    fleet_id=run.fleet_id,
                    calibration_id=run.calibration_id,
                    run_id=run.id,
                    camera=run.camera,
                    model=run.model,
                    fold=run.fold,
                    document=found,
                )
            )
        end_run(session, run, state)


@pytest.fixture
def three_runs(database):
    """Full fits of two models, and one fold of the first."""
    calibration_id, runs = make_calibration(database, models=("pinhole", "brown_conrady", "kannala_brandt"))
    with database.writing() as session:
        session.get_one(Calibration, calibration_id).publish = "recommended"
        session.execute(update(CalibrationRun).where(CalibrationRun.id == runs[2]).values(model="pinhole", fold=0))
    return calibration_id, runs


def ended(database, calibration_id):
    with database.reading() as session:
        row = session.get_one(Calibration, calibration_id)
        return row.state, row.summary, session.scalars(select(Publication.result_id)).all()


def test_a_cancelled_calibration_keeps_what_it_found_and_publishes_nothing(database, three_runs):
    calibration_id, (pinhole, brown, fold) = three_runs
    end(database, pinhole, found=document(5.0))
    end(database, brown, found=document(1.0))
    end(database, fold, "cancelled")
    state, summary, published = ended(database, calibration_id)
    assert state == "cancelled"
    assert set(summary["cameras"]["front"]["models"]) == {"pinhole", "brown_conrady"}
    assert published == []


def test_models_of_which_not_the_same_pairs_were_held_out_are_not_ranked(database, three_runs):
    calibration_id, (pinhole, brown, fold) = three_runs
    end(database, pinhole, found=document(5.0))
    end(database, brown, found=document(1.0))
    end(database, fold, found=document(5.0, [5.0, 6.0]))
    state, summary, published = ended(database, calibration_id)
    assert state == "done"
    assert summary["cameras"]["front"]["recommended"] is None
    assert "cannot be compared" in summary["cameras"]["front"]["why"]
    assert published == []


@pytest.mark.parametrize(("folds", "given"), [(True, 1), (False, 0)])
def test_the_lowest_error_is_recommended_and_published_where_pairs_were_held_out(database, folds, given):
    calibration_id, runs = make_calibration(database, models=("pinhole", "brown_conrady", "a", "b"))
    with database.writing() as session:
        session.get_one(Calibration, calibration_id).publish = "recommended"
        for run_id, model in zip(runs[2:], ("pinhole", "brown_conrady"), strict=True):
            session.execute(update(CalibrationRun).where(CalibrationRun.id == run_id).values(model=model, fold=0))
    for run_id, mean_px in zip(runs, (5.0, 1.0, 5.0, 1.0), strict=True):
        end(database, run_id, found=document(mean_px, [mean_px] if folds else []))
    state, summary, published = ended(database, calibration_id)
    assert (state, summary["cameras"]["front"]["recommended"]) == ("done", "brown_conrady")
    assert len(published) == given
