"""Checks that read what the solver found, and checks that test the residuals themselves."""

from dataclasses import replace

import numpy as np
import pytest

from tests.workers.reports.material import made
from workers.reports.checks import Check, by_clock, clock, elsewhere, rolling_shutter, together
from workers.reports.contents import contents, estimate_of

SHOWN = {"line_time_us": 55.0, "std_us": 11.0, "limit": 2.82, "shown": True}
ALARM = "Residuals along the board's motion grow with the image row, by 55.0 +- 11.0 us a row."
SOUND = Check("clock", "Clocks", "passed", "")


def walking(speed_m_s=1.0):
    """The material's fit, of an apex that moves to the left."""
    model = made().chosen
    moving = np.tile([0.0, speed_m_s, 0.0], (len(model.problem.points), 1))
    return replace(model, problem=replace(model.problem, velocities=moving))


def test_a_rolling_shutter_is_what_the_solver_says_of_it():
    found = estimate_of(walking())
    unknown = rolling_shutter({}, found, SOUND)
    assert (unknown.verdict, unknown.figures) == ("unknown", {})
    passed = rolling_shutter({"rolling_shutter": SHOWN | {"shown": False}}, found, SOUND)
    assert passed.verdict == "passed" and "55 ± 11 microseconds" in passed.sentence
    failed = rolling_shutter({"rolling_shutter": SHOWN, "alarms": [ALARM]}, found, SOUND)
    # In the words of the result's own alarm, so that the verdict says it once.
    assert (failed.verdict, failed.sentence) == ("failed", ALARM)
    assert "a rolling shutter" in rolling_shutter({"rolling_shutter": SHOWN}, found, SOUND).sentence


@pytest.mark.parametrize(("speed_m_s", "forbids"), [(0.01, False), (1.0, True)])
def test_it_forbids_the_use_where_marks_are_off_by_half_of_their_noise(speed_m_s, forbids):
    found = estimate_of(walking(speed_m_s))
    check = rolling_shutter({"rolling_shutter": SHOWN}, found, SOUND)
    px = 55e-6 * 0.5 * found.holding.image_size[1] * check.figures["speed_px_s"]
    assert (px > 0.5 * found.spread.sigma_px) == forbids == check.forbids


def test_clocks_that_explain_the_residuals_better_are_named_instead():
    found = estimate_of(walking())
    late = Check("clock", "Clocks", "failed", "", {"seconds": 0.04, "deviation_seconds": 0.004})
    check = rolling_shutter({"rolling_shutter": SHOWN}, found, late)
    assert check.verdict == "unknown" and "clocks' offset explains" in check.sentence
    late = replace(late, figures={"seconds": 0.004, "deviation_seconds": 0.001})
    assert rolling_shutter({"rolling_shutter": SHOWN}, found, late).verdict == "failed"


def test_late_clocks_are_found_with_their_offset():
    # A board that moves alike everywhere is a shift of the mount.
    assert clock(estimate_of(walking())).verdict == "unknown"
    model = made().chosen
    moving = np.outer(np.sin(1.7 * np.arange(len(model.problem.points))), [0.0, 1.2, 0.0])
    problem = replace(model.problem, velocities=moving)
    sound = clock(estimate_of(replace(model, problem=problem)))
    assert sound.verdict == "passed" and abs(sound.figures["seconds"]) < 4.0 * sound.figures["deviation_seconds"]
    pixels = model.problem.pixels + 0.04 * by_clock(estimate_of(replace(model, problem=problem)))
    late = clock(estimate_of(replace(model, problem=replace(problem, pixels=pixels))))
    assert late.verdict == "failed" and abs(abs(late.figures["seconds"]) - 0.04) < 0.01


def test_other_data_that_disagrees_forbids_the_use():
    agrees = {"verdict": "agrees", "sentence": "It holds."}
    against = {"verdict": "disagrees", "sentence": "The camera has turned."}
    unknown = {"verdict": "unknown", "sentence": "Too few."}
    assert elsewhere([]).verdict == elsewhere([unknown]).verdict == "unknown"
    assert elsewhere([unknown, agrees]).verdict == "passed"
    failed = elsewhere([agrees, against, unknown])
    assert (failed.verdict, failed.sentence, failed.forbids) == ("failed", "The camera has turned.", True)
    assert failed.figures == {"agrees": 1, "disagrees": 1, "unknown": 1}
    judged = contents(replace(made(), elsewhere=[against]))["verdict"]
    assert judged["level"] == "unsound" and "The camera has turned." in judged["against"]


def test_poses_that_err_together_are_named_beyond_chance():
    shared = {"blocks": 55, "by": "group", "deviations": {"offset_m": 0.005, "turn_deg": 0.0}, "widening": 1.08}
    assert together({}).verdict == "unknown"
    assert together({"shared_errors": shared | {"evidence": 11.0}}).verdict == "passed"
    found = together({"shared_errors": shared | {"evidence": 12.0}})
    assert (found.verdict, found.forbids) == ("failed", False)
    assert "by 5 mm from one to the next" in found.sentence and "1.08 times" in found.sentence
    alarm = "Pairs of one group err together, by 5 mm from group to group."
    assert together({"shared_errors": shared | {"evidence": 6.0}, "alarms": [alarm]}).sentence == alarm


def test_still_boards_say_nothing_of_clocks():
    document = contents(made())
    verdicts = {one["name"]: one["verdict"] for one in document["checks"]}
    assert verdicts["clock"] == verdicts["rolling_shutter"] == "unknown"
