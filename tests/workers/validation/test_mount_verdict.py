"""What is said of a mount by where its edges lie best: each limit from both sides, and what contradicts."""

import re

import numpy as np
import pytest

from tests.workers.validation.roads import calibration
from workers.validation.mount_search import Summit
from workers.validation.mount_verdict import FAR_DEG, SHARED_DEG, Summits, judge_mount

GROUPS = 40
# Student's t of 39 freedoms at 0.01 / 6 and 0.001 / 6.
LOOK, STOP = 3.13, 3.93


def place(
    turn_deg=(0.0, 0.0, 0.0), shift_m=(0.0, 0.0, 0.0), *, score=2.0, sigma_deg=0.0, sigma_m=1.0, is_summit=True
):
    """A place whose score every group has, alike but for a thousandth."""
    offset = np.concatenate([np.radians(turn_deg), shift_m])
    covariance = np.diag([*[np.radians(sigma_deg) ** 2] * 3, *[sigma_m**2] * 3])
    sums = score + 0.001 * np.random.default_rng(round(10_000 * score)).normal(size=GROUPS)
    return Summit(calibration(), offset, covariance, sums, np.ones(GROUPS), is_summit)


def seen(turn_deg=(0.0, 0.0, 0.0), *, apart_deg=None, near=(), far=(), shifted=None, moved=None, **of_place):
    turned = place(turn_deg, **of_place)
    apart_deg = float(np.linalg.norm(turn_deg)) if apart_deg is None else apart_deg
    # Three turns fit better than one or two.
    here = place(score=1.0) if apart_deg > FAR_DEG else place(turn_deg, **of_place | {"score": 1.9})
    return Summits(
        frames=30, parts=900, turned=turned, shifted=shifted or place(score=1.0), moved=moved or place(score=1.0),
        aimed=here, rolled=here, near=near, far=far, apart_deg=apart_deg,
    )  # fmt: skip


def verdict(frames=30, lanes=None, **of_seen):
    return judge_mount(seen(**of_seen), frames, lanes)


def lanes(pitch=0.0, yaw=0.0, said="agrees"):
    sigmas = {"sigma_pitch_deg": 0.02, "sigma_yaw_deg": 0.02}
    return {"verdict": said, "pitch_deg": pitch, "yaw_deg": yaw, "sentence": "Markers."} | sigmas


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize(
    ("sigmas", "said"),
    [(LOOK - 0.02, "pass"), (LOOK + 0.02, "look"), (STOP - 0.02, "look"), (-STOP - 0.02, "stop")],
)  # fmt: skip
def test_headline_and_axis_follow_the_worst_axis(axis, sigmas, said):
    turn = np.zeros(3)
    turn[axis] = sigmas * list(SHARED_DEG.values())[axis]
    judged = verdict(turn_deg=turn)
    assert (judged.verdict, judged.axes[axis].verdict) == (said, said)
    assert [other.verdict for other in judged.axes if other is not judged.axes[axis]] == ["pass", "pass"]
    assert (f"{turn[axis]:+.2f}" in judged.sentence) == (said != "pass")


def test_a_mount_passes_only_if_pitch_yaw_and_roll_are_told_and_figures_make_the_sentence_true():
    assert verdict().verdict == "pass"
    # A turn of half a degree must show in nine of ten drives: 3.13 + 1.28 deviations.
    limit = 0.5 / (LOOK + 1.28)
    vague = [np.sqrt((limit * share) ** 2 - SHARED_DEG["roll"] ** 2) for share in (0.99, 1.01)]
    assert verdict(sigma_deg=vague[0]).axes[2].verdict == "pass"
    judged = verdict(sigma_deg=vague[1])
    assert judged.verdict == "not_told" and "fits in pitch and yaw; this drive does not tell roll" in judged.sentence
    (shown,) = re.findall(r"from (\d\.\d\d) degrees", judged.axes[2].sentence)
    assert float(shown) > 0.5


def test_three_turns_at_once_are_believed_only_where_they_fit_clearly_better_than_fewer():
    """A published mount: three turns said +0.79 degrees of pitch, and led two of 0.15 by 0.9 deviations."""
    noisy = seen((0.79, 0.01, 1.07), apart_deg=1.03)
    assert judge_mount(noisy, 30).verdict == "stop"
    at_rest = place((0.15, -0.08, 0.0), score=1.9999)
    judged = judge_mount(noisy._replace(aimed=at_rest, rolled=at_rest), 30)
    assert judged.verdict == "pass" and judged.axes[0].turn_deg == pytest.approx(0.15)
    turned = place((0.79, 0.01, 0.0), score=1.9999)
    judged = judge_mount(noisy._replace(aimed=turned, rolled=at_rest), 30)
    assert [axis.verdict for axis in judged.axes] == ["stop", "pass", "not_told"]


def test_one_frame_is_never_a_stop():
    assert verdict(turn_deg=(0.0, 0.8, 0.0)).verdict == "stop"
    judged = verdict(1, turn_deg=(0.0, 0.8, 0.0))
    assert (judged.verdict, judged.axes[1].verdict) == ("look", "look")
    assert "has turned" not in judged.sentence and "no proof" in judged.sentence
    far = verdict(1, turn_deg=(0.0, 5.0, 0.0))
    assert (far.verdict, far.axes[1].verdict) == ("look", "look") and "may be far off" in far.sentence


def test_a_vehicle_whose_motion_is_not_told_is_never_a_stop():
    judged = judge_mount(seen((0.0, 0.8, 0.0)), 30, is_motion_told=False)
    assert (judged.verdict, judged.axes[1].verdict) == ("look", "look")
    assert "may have turned" in judged.sentence and "stay where they were measured" in judged.sentence
    assert judge_mount(seen(), 30, is_motion_told=False).verdict == "pass"


def test_far_off_is_said_to_a_degree_and_the_end_of_the_search_is_no_figure():
    judged = verdict(turn_deg=(0.3, -4.8, 0.2))
    assert judged.verdict == "stop" and "far off" in judged.sentence and "about -5 degrees of yaw." in judged.sentence
    assert [axis.verdict for axis in judged.axes] == ["not_told", "stop", "not_told"]
    wide = judge_mount(seen((0.3, -4.8, 0.2))._replace(left_deg=1.6), 30)
    assert wide.verdict == "stop" and "about -5 +- 2 degrees of yaw." in wide.sentence
    ended = verdict(turn_deg=(0.0, 10.0, 0.0), is_summit=False)
    assert ended.verdict == "not_told" and all(axis.turn_deg is None for axis in ended.axes)


def test_several_places_give_no_verdict():
    for where in ("near", "far"):
        assert verdict(**{where: [place(score=1.9999)]}).verdict == "not_told"
        assert verdict(**{where: [place(score=1.9)]}).verdict == "pass"
    far_off = {"turn_deg": (0.0, 5.0, 0.0), "far": [place(score=1.9999)]}
    assert verdict(**far_off).verdict == "not_told"


def test_edges_and_markers_that_contradict_each_other_give_no_verdict():
    """A sound simulated walk: edges said -0.81 and markers +0.92 degrees of pitch, +-0.02 each."""
    judged = verdict(turn_deg=(-0.81, 0.0, 0.0), lanes=lanes(pitch=0.92, said="disagrees"))
    assert judged.verdict == "not_told" and "-0.81 and +0.92 degrees of pitch" in judged.sentence
    assert {axis.verdict for axis in judged.axes} == {"not_told"}
    assert verdict(turn_deg=(-0.81, 0.0, 0.0), lanes=lanes(pitch=-0.8, said="disagrees")).verdict == "stop"
    assert verdict(lanes=lanes(pitch=0.2, said="disagrees")).verdict == "look"
    assert verdict(lanes=lanes(pitch=0.6, said="disagrees")).verdict == "not_told"


def test_a_shift_moves_near_markers_by_more_than_far_edges_which_is_no_contradiction():
    """Simulated, shifted by 10 cm down: edges said -0.20 and markers -0.57 degrees of pitch."""
    judged = verdict(turn_deg=(-0.2, 0.0, 0.0), lanes=lanes(pitch=-0.57, said="disagrees"))
    assert judged.verdict == "look" and judged.axes[0].verdict == "look"


def test_turned_shifted_and_either():
    by_yaw = {"turn_deg": (0.0, 0.6, 0.0)}
    assert verdict(**by_yaw).sentence.startswith("The camera has turned: ")
    shift = {"shift_m": (0.12, 0.0, 0.0), "sigma_m": 0.01}
    either = verdict(**by_yaw, shifted=place(**shift, score=2.0))
    assert "turned or shifted, and this drive does not tell which" in either.sentence
    judged = verdict(**by_yaw, shifted=place(**shift, score=2.1))
    assert judged.sentence.startswith("The camera has shifted by +12 +- 3 cm along x")
    assert all(axis.verdict == "not_told" for axis in judged.axes)
    alone = verdict(moved=place(**shift, score=2.1))
    assert alone.verdict == "look" and "may have shifted by +12" in alone.sentence


def test_few_parts_and_nothing():
    assert judge_mount(None, 5).verdict == judge_mount(seen()._replace(parts=7), 5).verdict == "not_told"
