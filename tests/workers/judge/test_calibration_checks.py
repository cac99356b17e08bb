"""Each check of a calibration's end finds what it is for, and a sound result passes all."""

import numpy as np
import pytest

from apexcal.documents.checks import Check
from apexcal.documents.comparisons import ResultDifference
from apexcal.documents.results import FitResult
from apexcal.documents.summaries import Behind, CameraSummary, RigSummary
from service.platform.db.base import new_id
from tests.support.results import fit_result, model_summary, of_block, rig_summary, summary
from workers.judge.calibration_checks import CurrentResult, checks_of_calibration
from workers.judge.held_out_check import HeldOutPairs, held_out_pairs

LENS = {"model": "pinhole", "f_x": 900.0, "f_y": 900.0, "c_x": 640.0, "c_y": 480.0, "image_size": [1280, 960]}
RESULT = fit_result(mean_px=1.25, sigma_px=1.0, explained_px=1.1, pairs=200, intrinsics=LENS)
BEHIND = dict.fromkeys(Behind.model_fields, 1.0) | {"log_likelihood": 20.0, "within_noise": False}
APART = {
    "rotation_deg": 0.5, "translation_mm": 20.0, "turn_deg": [], "shift_mm": [], "sigmas": 1.0, "differs": False,
    "incomparable": None, "field_px": None, "field_sigmas": None,
}  # fmt: skip
PAIR = rig_summary([])["pairs"][0]


def precision(over_limit):
    figures = {"over_limit": over_limit}
    return Check(
        name="precision", title="", verdict="pass", sentence="", remedy="", figures=figures, scope="mount_with_lens"
    )


def pairs(off_px=0.0, seed=1):
    """Held-out pairs with a noise of 1 px, and so much more beyond 32 m."""
    rng = np.random.default_rng(seed)
    distances = np.repeat([5.0, 20.0, 50.0], 60)
    marks = rng.normal(size=(180, 2))
    marks[distances > 32.0, 0] += off_px
    return HeldOutPairs(np.hypot(*marks.T), np.ones(180), distances)


def fitted(over_limit=0.5, **members):
    return FitResult.model_validate(RESULT | members | {"checks": [precision(over_limit)]})


def judged(change=None, *, recommended="pinhole", ended_well=True, rig=None, current=None, held=None, **marks):
    model = model_summary(new_id(), RESULT, **{"heldout_mean_px": 1.3, "heldout_sigma_px": 1.05} | (change or {}))
    of_camera = summary({"pinhole": model}, recommended=recommended, why="It is likelier.")["cameras"]["front"]
    whole = rig and RigSummary.model_validate({"alarms": [], "left_out": [], "pairs": [], "problem": None} | rig)
    checks = checks_of_calibration(
        fitted(), camera="front", summary=CameraSummary.model_validate(of_camera), ended_well=ended_well,
        pairs=held or pairs(), rig=whole, current=current, **marks,
    )  # fmt: skip
    return {check.name: check for check in checks}


def current(verdict="pass", heldout_mean_px=1.3, over_limit=0.5, members=None, **apart):
    compared = ResultDifference.model_validate(APART | apart)
    return CurrentResult(fitted(over_limit, **(members or {})), verdict, compared, heldout_mean_px)


def failed(checks):
    return {name: check.verdict for name, check in checks.items() if check.is_doubt}


def test_a_sound_result_passes_all():
    rig = {"pairs": [PAIR]}
    for of in (None, current()):
        checks = judged(rig=rig, current=of)
        assert failed(checks) == {} and all(check.sentence for check in checks.values())


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"heldout_mean_px": None}, "No pairs were held out"),
        ({"heldout_mean_px": 4.2}, "too few, too uneven"),
        ({"heldout_sigma_px": 1.9}, "noise is 1.9 px"),
    ],
)
def test_held_out_pairs_that_lie_far_off_are_looked_at(change, said):
    check = judged(change)["held_out"]
    assert check.verdict == "look" and said in check.sentence and check.remedy


def test_held_out_pairs_are_judged_where_points_are_used():
    assert judged(held=pairs(1.0))["held_out"].verdict == "pass"
    check = judged(held=pairs(4.0))["held_out"]
    assert check.verdict == "stop" and "about 50 m" in check.sentence
    assert check.figures["beyond_noise_at_50_m_px"] == pytest.approx(4.5, abs=0.8)


def test_held_out_pairs_that_do_not_belong_are_not_judged():
    def fold(indices, standard_px, stretch):
        return fitted(heldout=of_block(standard_px, indices) | {"stretch": stretch})

    folds = [fold([0, 2], [1.0, 99.0], [0.5, 1.0]), fold([1], [2.0], [1.0])]
    wrong = {"index": 2, "residual_px": 99.0, "score": 99.0, "reason": "", "excluded": False}
    points = [[distance, 0.0, 0.0] for distance in (5.0, 6.0, 7.0, 8.0)]
    found = held_out_pairs(fitted(outliers=[wrong]), folds, points)
    assert found.standard_px.tolist() == [1.0, 2.0] and found.stretch.tolist() == [0.5, 1.0]
    assert found.distances_m.tolist() == [5.0, 6.0]


def test_another_model_that_is_clearly_likelier_stops():
    assert judged({"behind": BEHIND}, recommended="brown_conrady")["models"].verdict == "stop"
    alike = BEHIND | {"within_noise": True}
    assert judged({"behind": alike}, recommended="brown_conrady")["models"].verdict == "look"
    assert judged(recommended=None)["models"].verdict == "look"


def test_runs_that_did_not_end_are_looked_at_and_cameras_that_do_not_agree_stop():
    assert failed(judged(ended_well=False)) == {"runs": "look"}
    apart = PAIR | {"alarms": ["They lie 9 sigmas apart."]}
    assert failed(judged(rig={"pairs": [apart]})) == {"rig": "stop"}
    assert failed(judged(rig={"pairs": [apart | {"cameras": ["left", "rear"]}]})) == {}
    assert failed(judged(rig={"problem": {"code": "bad_rotation", "detail": "No."}})) == {"rig": "look"}


@pytest.mark.parametrize(
    ("of", "said"),
    [
        (current(differs=True, sigmas=7.0), "7.0 times their stated errors"),
        (current(heldout_mean_px=0.6), "in the vehicle's current calibration 0.60"),
        (current(over_limit=0.3), "1.7 times as uncertain"),
    ],
)
def test_a_person_looks_before_a_better_current_result_is_replaced(of, said):
    check = judged(current=of)["current"]
    assert check.verdict == "look" and said in check.sentence


@pytest.mark.parametrize(
    "change",
    [
        *({"members": members} for members in ({"model": "brown_conrady"}, {"lens": "stated"})),
        *({"verdict": verdict, "over_limit": over} for verdict, over in (("look", 0.5), ("stop", 0.1), (None, 0.1))),
    ],
)
def test_mounts_are_compared_if_lens_and_model_are_alike_and_the_current_passes(change):
    assert failed(judged(current=current(differs=True, **change))) == {}


def test_marks_of_the_machine_that_people_confirmed_pass_and_their_bias_is_said():
    columns = {
        "machine": [False] * 3 + [True] * 4,
        "machine_off_px": [[0.5, -0.1], [0.7, 0.1], [0.6, 0.0], *[None] * 4],
    }
    check = judged(columns=columns | {"confirmed": [0, 0, 0, 1, 1, 1, 2]})["marks_confirmed"]
    assert (check.verdict, check.figures) == ("pass", {"machine": 0.0, "confirmed": 4.0})
    assert check.sentence == (
        "People confirmed 4 of 7 marks, which are the machine's. The machine's marks are off by +0.60 ± 0.06 px in u "
        "and +0.00 ± 0.06 px in v on average: people marked 3 corners blind."
    )
    some = judged(columns=columns | {"confirmed": [0, 0, 0, 0, 1, 1, 1]})["marks_confirmed"]
    assert (some.verdict, some.figures["machine"]) == ("look", 1.0) and "corners blind" in some.sentence


def test_marks_of_the_machine_are_looked_at_unless_people_marked_an_earlier_result_that_agrees():
    for machine in ((), [False] * 5):
        check = judged(columns={"machine": machine})["marks_confirmed"]
        assert (check.verdict, check.figures["machine"]) == ("pass", 0.0)
    columns = {"machine": [True, True, False]}
    alone = judged(columns=columns)
    assert failed(alone) == {"marks_confirmed": "look"}
    assert alone["marks_confirmed"].sentence.startswith("Nobody looked at 2 of 3 marks, which are the machine's")
    agrees = judged(columns=columns, confirming=current())["marks_confirmed"]
    assert agrees.verdict == "pass" and "Nobody looked" in agrees.sentence and "agrees" in agrees.sentence
    differs = judged(columns=columns, confirming=current(differs=True, sigmas=7.0))["marks_confirmed"]
    assert differs.verdict == "look" and "7.0 times their stated errors" in differs.sentence
    for members in ({"model": "brown_conrady"}, {"lens": "stated"}):
        assert judged(columns=columns, confirming=current(members=members))["marks_confirmed"].verdict == "look"
