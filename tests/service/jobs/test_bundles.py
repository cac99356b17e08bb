"""The cost model reads as its comment says."""

from __future__ import annotations

from service.jobs.bundles import TRIP_MS, TRIPS_PER_BUNDLE, cut, plan, shards, slot_ms


def test_a_request_may_force_either_form():
    assert plan("slots", slots=5, slot_cost_ms=1, waiting_runs=9, workers=2) == ("slots", 1)
    assert plan("runs", slots=20, slot_cost_ms=900, waiting_runs=1, workers=8) == ("runs", 20)


def test_small_slots_ride_in_one_job():
    cost = slot_ms("pinhole", 222, 800, 30)
    assert plan("auto", slots=5, slot_cost_ms=cost, waiting_runs=1, workers=8).farm == "runs"


def test_large_slots_are_farmed_while_workers_idle_and_not_otherwise():
    cost = slot_ms("brown_conrady", 2000, 2000, 50)
    farmed = plan("auto", slots=20, slot_cost_ms=cost, waiting_runs=1, workers=4)
    assert farmed.farm == "slots"
    assert farmed.bundle * cost >= TRIPS_PER_BUNDLE * TRIP_MS
    assert plan("auto", slots=20, slot_cost_ms=cost, waiting_runs=4, workers=4).farm == "runs"


def test_cuts_cover_everything_once():
    assert [list(part) for part in cut(5, 2)] == [[0, 1], [2, 3], [4]]
    for sweeps in (0, 1, 299, 300, 601, 1200, 5000):
        parts = shards(sweeps, 4)
        assert [index for part in parts for index in part] == list(range(sweeps))
        assert len(parts) <= 4
