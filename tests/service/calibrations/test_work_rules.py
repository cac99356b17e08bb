"""What would take a farm for days, or one worker past its time limit, is refused before anything is made."""

import pytest
from sqlalchemy import func, select, update

from service.calibrations.work_rules import LONGEST_SLOT_S, MOST_FITTED_PAIRS, MOST_SLOTS
from service.platform.db.models import Calibration, CalibrationRun, CorrespondenceSet, Job
from service.platform.settings import get_settings
from tests.faults.jobs import pairs
from tests.support.asking import bring_pairs
from tests.support.uploads import new_vehicle


@pytest.fixture
def ask(engineer, fleet):
    made = new_vehicle(engineer, fleet, "car")
    brought = bring_pairs(engineer, made["rig"], pairs(60, 1))

    def post(**body):
        wanted = {"correspondence_set_ids": [brought], **body}
        return engineer.post(f"/vehicles/{made['vehicle']}/calibrations", wanted)

    return post


def made(api):
    with api.database.reading() as session:
        return [
            session.scalar(select(func.count()).select_from(table)) for table in (Calibration, CalibrationRun, Job)
        ]


def test_the_largest_schedule_is_refused_and_nothing_is_made(api, ask):
    largest = {"slots": 1000, "population": 100_000, "generations": 10_000, "max_iterations": 1000}
    # One slot of a pinhole on 60 pairs takes a minute and a half.
    answer = ask(schedule=largest)
    assert (answer.status_code, answer.json()["code"]) == (422, "work_too_long")
    assert answer.json()["limit_seconds"] == LONGEST_SLOT_S < answer.json()["predicted_seconds"]
    # In shorter slots it takes months.
    answer = ask(schedule=largest | {"generations": 500})
    refused = answer.json()
    assert (answer.status_code, refused["code"]) == (422, "calibration_too_large")
    assert refused["limit_seconds"] == 24 * 3600 < refused["predicted_seconds"] / 100
    assert "processor hours" in refused["detail"] and "schedule.slots" in refused["hint"]
    assert made(api) == [0, 0, 0]


def test_what_is_too_much_is_said_with_what_to_lower(api, ask, monkeypatch):
    with api.database.writing() as session:
        session.execute(update(CorrespondenceSet).values(count=100_000))
    few = {"models": ["kannala_brandt"], "folds": 0}
    slot = ask(**few, schedule={"slots": 1, "population": 50_000, "generations": 1000, "max_iterations": 1}).json()
    assert (
        slot["code"] == "work_too_long" and "One slot of kannala_brandt on 100,000 pairs of front" in slot["detail"]
    )
    assert "schedule.population" in slot["hint"]
    assert slot["limit_seconds"] == LONGEST_SLOT_S < slot["predicted_seconds"]
    assert ask(**few).status_code == 202, "the default schedule on the most pairs that a set may have"
    fitted = ask(folds=20).json()
    assert fitted["code"] == "calibration_too_large" and f"one may fit {MOST_FITTED_PAIRS:,}" in fitted["detail"]
    with api.database.writing() as session:
        session.execute(update(CorrespondenceSet).values(count=60))
    schedule = {"slots": 1000, "population": 64, "generations": 1, "max_iterations": 1000}
    slots = ask(**few, schedule=schedule).json()
    assert slots["code"] == "calibration_too_large" and f"one may run {MOST_SLOTS:,}" in slots["detail"]
    monkeypatch.setenv("APEXCAL_CALIBRATION_HOURS", "0.001")
    get_settings.cache_clear()
    assert ask().json()["code"] == "calibration_too_large", "the operator says how much"
    assert made(api)[0] == 1


def test_a_run_that_is_too_long_for_one_job_is_cut_whatever_is_asked(api, ask):
    with api.database.writing() as session:
        session.execute(update(CorrespondenceSet).values(count=100_000))
    assert ask(models=["kannala_brandt"], folds=0, farm="runs").status_code == 202
    with api.database.reading() as session:
        run = session.scalars(select(CalibrationRun)).one()
        assert (run.farm, run.slots, run.bundle) == ("slots", 2, 2)
