"""Runs are cut by what they cost."""

from __future__ import annotations

from apexcal.documents.schedules import PRESETS, Schedule
from service.platform.jobs.bundles import (
    BUNDLE_S,
    RUN_S,
    TRIP_MS,
    TRIPS_PER_BUNDLE,
    RunCost,
    choose_farming,
    cut,
    run_cost,
    shards,
)

SMALL = run_cost("pinhole", 222, PRESETS["paper"].schedule)
LARGE = run_cost("brown_conrady", 2000, PRESETS["toolbox"].schedule)


def test_a_request_may_force_either_form():
    assert choose_farming("slots", slots=5, cost=SMALL, waiting_runs=9, workers=2) == ("slots", 1)
    assert choose_farming("runs", slots=20, cost=LARGE, waiting_runs=1, workers=8) == ("runs", 20)


def test_small_slots_ride_in_one_job():
    assert choose_farming("auto", slots=5, cost=SMALL, waiting_runs=1, workers=8).farm == "runs"


def test_large_slots_are_farmed_while_workers_idle_and_not_otherwise():
    farmed = choose_farming("auto", slots=20, cost=LARGE, waiting_runs=1, workers=4)
    assert farmed.farm == "slots"
    assert farmed.bundle * LARGE.slot_s >= 1e-3 * TRIPS_PER_BUNDLE * TRIP_MS
    assert choose_farming("auto", slots=20, cost=LARGE, waiting_runs=4, workers=4).farm == "runs"


def test_no_job_is_longer_than_a_few_seconds_and_a_slot():
    for slot_s in (0.001, 0.01, 0.3, 2.0, 40.0):
        for slots, iterations in ((1, 60), (4, 60), (1000, 500)):
            cost = RunCost(slot_s, slots * iterations, 0.1)
            for farm in ("auto", "runs"):
                for waiting in (1, 100):
                    found = choose_farming(farm, slots=slots, cost=cost, waiting_runs=waiting, workers=8)
                    longest = cost.seconds if found.farm == "runs" else found.bundle * slot_s
                    assert longest <= (RUN_S if found.farm == "runs" else max(BUNDLE_S, slot_s)), (cost, found)
                    assert 1 <= found.bundle <= slots


def test_a_run_of_very_many_small_slots_is_not_written_in_one_transaction():
    cost = run_cost("pinhole", 6, Schedule(slots=1000, population=64, generations=1, max_iterations=100))
    assert cost.seconds < RUN_S
    assert choose_farming("auto", slots=1000, cost=cost, waiting_runs=9, workers=2).farm == "slots"


def test_cuts_cover_everything_once():
    assert [list(part) for part in cut(5, 2)] == [[0, 1], [2, 3], [4]]
    for sweeps in (0, 1, 299, 300, 601, 1200, 5000):
        parts = shards(sweeps, 4)
        assert [index for part in parts for index in part] == list(range(sweeps))
        assert len(parts) <= 4
