"""Each check of a calibration's end finds what it is for, and a sound result passes all."""

import numpy as np
import pytest

from apexcal.documents.checks import Check
from workers.judge.calibration_checks import CurrentResult, checks_of_calibration
from workers.judge.held_out_check import HeldOut, held_out_pairs

RESULT = {
    "model": "pinhole", "lens": "fitted", "kept": {"mean_px": 1.25, "pairs": 200}, "sigma_px": 1.0,
    "free_parameters": 10, "explained_px": 1.1, "intrinsics": {"f_x": 900.0, "f_y": 900.0},
}  # fmt: skip
BEHIND = {"log_likelihood": 20.0, "within_noise": False}
APART = {"rotation_deg": 0.5, "translation_mm": 20.0, "sigmas": 1.0, "differs": False}


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
    return HeldOut(np.hypot(*marks.T), np.ones(180), distances)


def judged(change=None, *, recommended="pinhole", ended_well=True, rig=None, current=None, held=None, over_limit=0.5):
    model = {"heldout_mean_px": 1.3, "heldout_sigma_px": 1.05, **(change or {})}
    summary = {
        "recommended": recommended,
        "why": "It is likelier.",
        "models": {"pinhole": model, "brown_conrady": {}},
    }
    checks = checks_of_calibration(
        RESULT, checks=[precision(over_limit)], camera="front", summary=summary, ended_well=ended_well,
        pairs=held or pairs(), rig=rig, current=current,
    )  # fmt: skip
    return {check.name: check for check in checks}


def current(**change):
    given = {"model": "pinhole", "lens": "fitted", "verdict": "pass", "checks": [precision(0.5)], "compared": APART}
    return CurrentResult(**given | {"heldout_mean_px": 1.3} | change)


def failed(checks):
    return {name: check.verdict for name, check in checks.items() if check.verdict != "pass"}


def test_a_sound_result_passes_all():
    rig = {"pairs": [{"cameras": ["front", "left"], "alarms": []}]}
    for of in (None, current()):
        checks = judged(rig=rig, current=of)
        assert failed(checks) == {} and all(check.sentence for check in checks.values())


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"heldout_mean_px": None}, "No pairs were held out"),
        ({"heldout_mean_px": 4.2}, "too few, too uneven"),
        ({"heldout_sigma_px": 1.9}, "noise of 1.9 px"),
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
    folds = [
        {"indices": [0, 2], "standard_px": [1.0, 99.0], "stretch": [0.5, 1.0]},
        {"indices": [1], "standard_px": [2.0], "stretch": [1.0]},
    ]
    found = held_out_pairs(folds, [{"index": 2}], [5.0, 6.0, 7.0, 8.0])
    assert found.standard_px.tolist() == [1.0, 2.0] and found.stretch.tolist() == [0.5, 1.0]
    assert found.distances_m.tolist() == [5.0, 6.0]


def test_another_model_that_is_clearly_likelier_stops():
    assert judged({"behind": BEHIND}, recommended="brown_conrady")["models"].verdict == "stop"
    alike = BEHIND | {"within_noise": True}
    assert judged({"behind": alike}, recommended="brown_conrady")["models"].verdict == "look"
    assert judged(recommended=None)["models"].verdict == "look"


def test_runs_that_did_not_end_are_looked_at():
    assert failed(judged(ended_well=False)) == {"runs": "look"}


def test_cameras_that_do_not_agree_stop():
    apart = {"cameras": ["front", "left"], "alarms": ["They lie 9 sigmas apart."]}
    assert failed(judged(rig={"pairs": [apart]})) == {"rig": "stop"}
    assert failed(judged(rig={"pairs": [apart | {"cameras": ["left", "rear"]}]})) == {}
    assert failed(judged(rig={"problem": {"detail": "No."}})) == {"rig": "look"}


@pytest.mark.parametrize(
    ("of", "said"),
    [
        (current(compared=APART | {"differs": True, "sigmas": 7.0}), "7.0 times what both state"),
        (current(heldout_mean_px=0.6), "of the vehicle's current result 0.60"),
        (current(newer=["It is of an older rig."]), "older rig"),
        (current(checks=[precision(0.3)]), "1.7 times those"),
    ],
)
def test_a_person_looks_before_a_better_current_result_is_replaced(of, said):
    check = judged(current=of)["current"]
    assert check.verdict == "look" and said in check.sentence


def test_a_current_result_that_should_not_be_used_protects_nothing():
    differs = APART | {"differs": True}
    assert failed(judged(current=current(verdict="stop", compared=differs, checks=[precision(0.1)]))) == {}


@pytest.mark.parametrize("change", [{"model": "brown_conrady"}, {"lens": "stated"}, {"verdict": "look"}])
def test_mounts_are_compared_if_lens_and_model_are_alike_and_the_current_passes(change):
    assert failed(judged(current=current(compared=APART | {"differs": True}, **change))) == {}
