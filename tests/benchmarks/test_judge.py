"""The bench of the judge goes the product's own path, and its tables say what came of it."""

import pytest

from benchmarks.judge.__main__ import cases_table, checks_table, summary
from benchmarks.judge.cases import CASES
from benchmarks.judge.judging import BROKEN, outcome
from benchmarks.judge.remedies import REMEDIED, followed, remedies_summary, remedies_table


def test_a_sound_walk_is_published_and_a_wrong_lens_model_is_not():
    cases = [case for case in CASES if case.name in ("people, none wrong", "wrong model")]
    by_case = {case.name: [outcome(case, 3)] for case in cases}
    (sound,), (wrong,) = by_case.values()
    assert (sound.verdict, sound.is_wrong, sound.error_px < 2.0) == ("pass", False, True)
    assert (wrong.verdict, wrong.is_wrong, wrong.failed["lens_model"]) == ("stop", True, "stop")
    figures = summary(cases, by_case)
    assert (figures["published_wrong"], figures["sound_published"], figures["sound_stopped"]) == (0, 1.0, 0.0)
    # One of one: at least 0.025 by Clopper and Pearson.
    assert figures["sound_published_interval"] == [0.025, 1.0]
    assert "| wrong model | 1 | 0.000 (0.000-0.975) |" in cases_table(cases, by_case)
    assert "| `lens_model` | 0 | wrong model 1.00 |" in checks_table(cases, by_case)


def test_remedies_that_trials_advise_lessen_the_error_and_intervals_hold():
    numbers = {case.name: number for number, case in enumerate(REMEDIED)}
    kept = followed((numbers["15 % on the hand, kept"], 10))
    late = followed((numbers["clocks apart"], 10))
    assert (kept.check, late.check) == ("wrong_pairs", "clock")
    assert all(one.after.px < one.before.px and one.after.held > 0.8 for one in (kept, late))
    figures = remedies_summary([kept, late])
    assert (figures["draws"], figures["followed"]) == (2, 2)
    assert figures["rms_px_after"] < figures["rms_px_before"]
    assert "wrong_pairs 1" in remedies_table([kept, late])


def test_a_remedy_is_judged_though_its_lens_folds_before_the_farthest_corners():
    (number,) = [number for number, case in enumerate(REMEDIED) if case.name == "lens of another camera"]
    assert followed((number, 6200012)).check != BROKEN


@pytest.mark.slow
def test_a_board_that_stood_in_two_places_is_judged_though_its_halves_determine_little():
    (two,) = [case for case in CASES if case.name == "two poses"]
    for seed in (59574302, 59574321, 59574346):
        assert outcome(two, seed, with_folds=False).verdict == "stop"
