"""Each check finds what it is for, and a sound fit passes all."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from apexcal.documents.fit_requests import fit_request
from apexcal.documents.results import FitResult
from tests.workers.judge.fits import FOCAL_PX, checked, failed, lens_of, rig
from tests.workers.solver.few_pairs import SHORT, real
from tests.workers.solver.rigs import NOMINAL, PLAIN, SIZE
from tests.workers.solver.test_optima import small_board
from tests.workers.solver.walks import ended, posed
from workers.judge.agreement_checks import fit
from workers.judge.causes import image_velocities
from workers.judge.effects import Effect, marked_rays, worst_axis
from workers.judge.fit_checks import checks_of_fit, without_outliers
from workers.judge.pair_checks import places_of
from workers.judge.precision_checks import mount_alone, precision
from workers.judge.topics import graded
from workers.judge.validation_checks import elsewhere
from workers.solver.estimate import estimate
from workers.solver.narrowing import run_search
from workers.solver.prediction import covariances_along
from workers.solver.problem import fit_problem
from workers.solver.solution import finished
from workers.tasks.run_inputs import read_run
from workers.tasks.solving import solved


@pytest.mark.parametrize("lens", ["pinhole", "brown_conrady", "kannala_brandt"])
def test_a_sound_fit_passes_all(lens):
    checks = checked(*rig(lens))
    assert {"fit", "optima"} <= checks.keys()
    assert failed(checks) == {}
    assert all(check.sentence and not check.remedy for check in checks.values() if check.verdict == "pass")


def below(share):
    """Marks of that share of the pairs lie 80 px too low, as on the hand."""

    def edit(points, pixels, rng):
        pixels[rng.uniform(size=len(pixels)) < share, 1] += 80.0

    return edit


def test_a_few_slips_pass_more_are_looked_at_and_those_in_the_fit_are_never_passed():
    assert failed(checked(*rig(edit=below(0.02)))) == {}
    found = checked(*rig(edit=below(0.12)))["wrong_pairs"]
    assert (found.verdict, found.figures["excluded"]) == ("look", found.figures["wrong"])
    assert checked(*rig("pinhole", edit=below(0.32)))["wrong_pairs"].verdict == "stop"
    one = checked(*rig(edit=below(0.01), **PLAIN))["wrong_pairs"]
    assert one.verdict == "look" and "in the fit and move the mount by" in one.sentence
    assert checked(*rig(edit=below(0.12), **PLAIN))["wrong_pairs"].verdict == "stop"


def test_other_checks_look_at_the_pairs_that_belong():
    problem, start = rig(edit=below(0.05), **PLAIN)
    found = estimate(problem, np.array(start))
    assert not without_outliers(found).fitted.weights.all() and found.fitted.weights.all()
    assert failed(checked(problem, start)).keys() == {"wrong_pairs", "precision", "coverage"}


def test_a_lens_model_that_does_not_fit_stops_and_decentring_under_one_without_it_is_found():
    for lens in ("brown_conrady", "kannala_brandt"):
        assert checked(*rig(lens, model="pinhole"))["lens_model"].verdict == "stop"

    def decentred(points, pixels, rng):
        centre, half = np.array(SIZE) / 2, np.hypot(*SIZE) / 2
        x, y = ((pixels - centre) / half).T
        pixels += 8.0 * np.column_stack([3 * x * x + y * y, 2 * x * y])

    assert checked(*rig("kannala_brandt", edit=decentred))["lens_model"].verdict != "pass"


def test_bounds_that_are_reached_stop():
    bounds = {"f_x": [400.0, 0.97 * FOCAL_PX]}
    problem, start = rig("pinhole", bounds=bounds)
    check = checked(problem, start)["bounds"]
    assert check.verdict == "stop" and "f_x" in check.sentence


@pytest.mark.parametrize(
    ("name", "mean", "sigma", "verdict"),
    [
        *(("t_x", off_m, 0.02, "pass") for off_m in (0.0, 0.02, 0.2)),
        ("t_x", 0.2, 0.007, "look"),
        ("f_x", FOCAL_PX + 60.0, 12.0, "pass"),
        ("f_x", FOCAL_PX + 60.0, 1.2, "stop"),
    ],
)
def test_a_prior_that_is_off_stops_where_it_moves_points_of_use(name, mean, sigma, verdict):
    """A prior that is 10 deviations off moves points by 0.07 of what use allows where the pairs know better."""
    check = checked(*rig("pinhole", priors={name: {"mean": mean, "sigma": sigma}}))["priors"]
    assert check.verdict == verdict and (verdict == "pass" or name in check.sentence)


@pytest.mark.parametrize(("factor", "verdict"), [(1.0, "pass"), (1.05, "stop")])
def test_a_stated_lens_that_does_not_explain_the_pairs_stops_a_result_that_rests_on_it(factor, verdict):
    names = ("f_x", "f_y", "c_x", "c_y")
    values = dict(zip(names, lens_of("pinhole").tolist(), strict=True))
    values |= {"f_x": factor * values["f_x"], "f_y": factor * values["f_y"]}
    stated = {"model": "pinhole", **values, "image_size": list(SIZE)}
    locked = checked(*rig("pinhole", locked=values, stated_lens=stated))
    assert locked["stated_lens"].verdict == verdict
    assert (locked["mount_alone"].verdict == "pass") == (factor == 1.0) or factor != 1.0
    # A lens of its own holds, but not on the vehicle that projects through the stated one.
    free = checked(*rig("pinhole", stated_lens=stated))
    assert free["stated_lens"].verdict == ("pass" if factor == 1.0 else "look")


def test_a_stated_lens_is_not_passed_where_the_residuals_show_another():
    names = ("f_x", "f_y", "c_x", "c_y")
    values = dict(zip(names, lens_of("pinhole").tolist(), strict=True)) | {"f_x": 1.05 * lens_of("pinhole")[0]}
    stated = {"model": "pinhole", **values, "image_size": list(SIZE)}
    found, result = ended(*rig("pinhole", locked=values, stated_lens=stated))
    assert result.stated_lens
    # As if the pairs told a lens of their own too badly to compare the two.
    unsure = result.model_copy(update={"stated_lens": result.stated_lens.model_copy(update={"explains": True})})
    checks = {check.name: check for check in checks_of_fit(found, unsure, pairs={})}
    assert checks["lens_model"].verdict == "stop" and "The stated lens does not fit" in checks["lens_model"].sentence
    assert "--intrinsics-as free" in checks["lens_model"].remedy
    assert checks["stated_lens"].verdict == "not_checked"


def test_a_stated_lens_that_no_model_here_is_is_said_with_the_reason():
    unused = {"unused": "no model here is 'plumb_bob' with 12 coefficients"}
    check = checked(*rig("pinhole", stated_lens=unused))["stated_lens"]
    assert check.verdict == "look" and "'plumb_bob' with 12 coefficients" in check.sentence and check.remedy


@pytest.mark.parametrize(("share", "axis", "verdict"), [(0.5, 0, "pass"), (0.09, 1, "pass"), (0.02, 1, "look")])
def test_marks_that_leave_half_of_the_image_unknown_are_looked_at(share, axis, verdict):
    """A few heights or half of the width are enough if they tell the lens beside them."""
    problem, start = rig("brown_conrady", pairs=400 if share > 0.1 else 3000)
    size = np.array(SIZE)
    inside = np.abs(problem.pixels[:, axis] - size[axis] / 2) < 0.5 * share * size[axis]
    check = checked(replace(problem, weights=inside * 1.0), start)["coverage"]
    assert check.verdict == verdict
    assert verdict == "pass" or f"more of its {('width', 'height')[axis]}" in check.remedy


def test_few_pairs_and_few_places_are_looked_at():
    lens = dict(zip(("f_x", "f_y", "c_x", "c_y"), lens_of("pinhole").tolist(), strict=True))
    check = checked(*rig("pinhole", pairs=8, locked=lens))["pairs"]
    assert check.verdict == "look" and "degrees of freedom" in check.sentence
    assert "lock" not in check.remedy, "the whole lens is locked"
    near = np.random.default_rng(1).normal(0.0, 0.2, (40, 3))
    assert places_of(np.concatenate([near, near + np.array([5.0, 0.0, 0.0])])) == 2
    check = checked(*posed(1, poses=2, repeats=20, locked=lens))["pairs"]
    assert check.verdict == "look" and check.figures["places"] == 2


def test_nobody_is_asked_to_mark_where_the_machine_marked_all():
    problem, start = rig("pinhole", pairs=12, noise_px=6.0)
    of_machine = {"machine": [True] * 12, "confirmed": [0] * 12}
    found, result = ended(problem, start)
    doubted = [check for check in checks_of_fit(found, result, pairs=of_machine) if check.is_doubt]
    assert {"pairs", "precision"} <= {check.name for check in doubted}
    assert not [check.remedy for check in doubted if "Mark" in check.remedy]
    by_name = {
        check.name: check for check in checks_of_fit(found, result, pairs=of_machine | {"confirmed": [1] * 12})
    }
    assert "Mark more corners" in by_name["precision"].remedy


@pytest.mark.parametrize("pairs", [20, 26, 30])
def test_as_many_more_marks_as_are_advised_are_enough_and_fewer_are_not(pairs):
    said = checked(*rig(pairs=pairs))["pairs"]
    more = int(re.search(r"Mark (\d+) more corners", said.remedy)[1])
    assert "lock what is known" in said.remedy

    def freedom(drawn):
        """With the pairs that were left out as slips."""
        figures = checked(*rig(pairs=drawn))["pairs"].figures
        return figures["degrees_of_freedom"] + 2.0 * (drawn - figures["pairs"])

    assert freedom(pairs + more) > 50.0 - 1e-6
    assert freedom(pairs + more - 4) < 50.0


@pytest.mark.parametrize(("noise_px", "verdict"), [(1.2, "pass"), (2.5, "look"), (5.0, "stop")])
def test_noise_beyond_what_marks_and_vertices_explain(noise_px, verdict):
    check = checked(*rig("pinhole", noise_px=noise_px))["noise"]
    assert check.verdict == verdict
    check = checked(*rig("pinhole", noise_px=noise_px), gap_ns=[30_000_000] * 222)["noise"]
    assert ("pairing mode auto" in check.remedy) == (verdict != "pass")


@pytest.mark.parametrize(("count", "verdict"), [(0, "pass"), (1, "look"), (20, "stop")])
def test_marks_that_belong_and_lie_outside_of_the_image(count, verdict):
    problem, start = rig("pinhole")
    u = np.sort(problem.pixels[:, 0])
    width = int(u[-1 - count]) + 1
    narrower = replace(problem, image_size=(width, SIZE[1]))
    check = checked(narrower, start)["marks_outside"]
    assert (check.verdict, check.figures["outside"]) == (verdict, np.count_nonzero(u > width + 0.5))


def moving(problem, seed=5):
    velocities = np.random.default_rng(seed).normal(0.0, 0.8, (len(problem.points), 3))
    return replace(problem, velocities=velocities)


def test_late_clocks_stop_with_their_offset():
    problem, start = rig("pinhole")
    unchecked = checked(problem, start)["clock"]
    assert unchecked.verdict == "not_checked" and "pairs without times" in unchecked.sentence and unchecked.remedy
    problem = moving(problem)
    sound = checked(problem, start)["clock"]
    assert sound.verdict == "pass" and abs(sound.figures["seconds"]) < 4.0 * sound.figures["deviation_seconds"]
    late = problem.pixels + 0.04 * image_velocities(estimate(problem, np.array(start)))
    check = checked(replace(problem, pixels=late), start)["clock"]
    assert check.verdict == "stop" and abs(abs(check.figures["seconds"]) - 0.04) < 0.01


def test_rows_that_are_read_in_turn_are_named_and_no_clock():
    problem, start = rig("pinhole")
    problem = moving(problem)
    assert checked(problem, start)["rolling_shutter"].verdict == "pass"
    moved = image_velocities(estimate(problem, np.array(start)))
    late = problem.pixels + 60e-6 * problem.rows_below[:, None] * moved
    checks = checked(replace(problem, pixels=late), start)
    # The board went all ways alike, so that the rows turn nothing.
    assert (checks["rolling_shutter"].verdict, checks["clock"].verdict) == ("pass", "pass")
    assert "one after the other" in checks["rolling_shutter"].sentence
    assert "is within chance (fitted with rows read in turn)" in checks["clock"].sentence
    assert abs(abs(checks["rolling_shutter"].figures["line_time_us"]) - 60.0) < 20.0


@pytest.mark.parametrize(("turned_deg", "verdict"), [(0.06, "look"), (0.5, "stop")])
def test_a_mount_that_turned_halfway_is_found_by_halves(turned_deg, verdict):
    def turn(points, pixels, rng):
        half = len(points) // 2
        slope = (pixels[half:, 0] - SIZE[0] / 2) / FOCAL_PX
        pixels[half:, 0] += np.radians(turned_deg) * FOCAL_PX * (1.0 + slope**2)

    assert checked(*rig("pinhole", edit=turn, noise_px=0.3))["halves"].verdict == verdict


def test_large_shared_errors_are_looked_at_and_small_ones_are_counted():
    def check(offset_m):
        return checked(*posed(3, poses=24, repeats=2, offset_m=offset_m, noise_px=0.7))["shared_errors"]

    assert check(0.0).verdict == "pass"
    small, large = check(0.004), check(0.05)
    assert small.verdict == "pass" and "The stated errors include this" in small.sentence
    assert large.verdict == "look" and large.figures["noise_px"] < 1.0


def test_precision_is_judged_where_points_are_used():
    """A free lens leaves the mount alone open, and points where the marks are well placed."""
    many = checked(*rig())
    assert many["precision"].verdict == "pass" and many["precision"].figures["half_width_at_20_m_px"] < 2.0
    few = checked(*rig(pairs=24, noise_px=2.0))["precision"]
    assert few.verdict == "look" and "times the limit (2 px, 1.5 mrad or 14.6 mm)" in few.sentence
    assert checked(*rig(pairs=24, noise_px=6.0))["precision"].verdict == "stop"


def test_few_pairs_widen_what_is_judged_by_students_t():
    found, result = ended(*rig("pinhole", pairs=12))
    C = covariances_along(found, marked_rays(found))[0]
    # Nothing is shared: every variance has the freedom of the noise.
    student = stats.t.ppf(0.975, found.spread.freedom) * result.prediction.expected_over_stated
    widest = np.quantile(student * np.sqrt(np.linalg.eigvalsh(C)[..., -1]), 0.95, axis=1)
    assert found.spread.freedom < 15.0 and student > 2.1
    judged = precision(found, result, {}).figures
    assert [judged[f"half_width_at_{at}_m_px"] for at in (5, 20, 50)] == pytest.approx(widest.tolist(), rel=1e-3)


def test_what_is_stated_of_all_pairs_is_known_also_where_pairs_are_few():
    problem, start = rig("pinhole", pairs=12, common_errors={"tip_up_mm": 30.0})
    found, result = ended(problem, start)
    freedoms = worst_axis(found).freedoms
    assert np.median(freedoms[0]) > 20.0 * found.spread.freedom
    C = covariances_along(found, marked_rays(found))[0]
    widest = np.quantile(1.97 * np.sqrt(np.linalg.eigvalsh(C)[0, :, -1]), 0.95)
    said = precision(found, result, {})
    assert said.figures["half_width_at_5_m_px"] == pytest.approx(widest, rel=0.03)
    assert said.is_doubt and "measure the board" in said.remedy


def test_nobody_is_asked_to_measure_the_board_where_the_marks_are_what_is_inexact():
    said = checked(*rig("pinhole", pairs=12, noise_px=6.0, common_errors={"tip_up_mm": 5.8}))["precision"]
    assert said.is_doubt and "measure" not in said.remedy


def test_the_mount_alone_is_judged_by_degrees_and_millimetres():
    half = dict.fromkeys(("rotation_x", "rotation_y", "rotation_z"), 0.3)
    half |= dict.fromkeys(("t_x", "t_y", "t_z"), 0.03)
    assert (
        mount_alone(FitResult.model_construct(interval95_half_width=half, lens="stated", next_steps=None)).verdict
        == "pass"
    )
    for name, value in (("rotation_x", 0.5), ("t_z", 0.05), ("t_z", None)):
        of = {"interval95_half_width": half | {name: value}, "lens": "fitted", "next_steps": None}
        check = mount_alone(FitResult.model_construct(**of))
        assert (check.verdict, check.scope) == ("stop", "mount_alone")


ADVICE = re.compile(r"\b([Cc]heck|[Mm]ark|[Ll]ock|[Bb]ound|[Ww]iden|[Cc]alibrate|[Rr]un it|[Ll]oad|[Gg]ive)\b")


def test_a_sentence_says_what_is_and_the_remedy_what_to_do():
    line = np.linspace([4.0, 0.0, 0.0], [9.0, 1.0, 0.0], 40)
    request = {"model": "pinhole", "image_size": SIZE, "nominal": NOMINAL, "schedule": SHORT}
    marks = np.random.default_rng(0).uniform(100.0, 900.0, (40, 2))
    degenerate = fit_problem(fit_request(**request), line, marks)
    open_end = finished(degenerate, run_search(degenerate)).result
    two_mounts = small_board(0)
    found = finished(two_mounts, run_search(two_mounts))
    assert open_end.status == "not_determined" and found.result.several_optima
    checks = [fit(open_end), *checks_of_fit(found.estimate, found.result)]
    checks += checked(*rig(pairs=24, noise_px=60.0)).values()
    assert {"fit", "optima", "noise"} <= {check.name for check in checks if check.verdict == "stop"}
    for check in checks:
        assert not ADVICE.search(check.sentence), check.sentence
        assert not re.search(r"[0-9]e[-+][0-9]", check.sentence + check.remedy), check.sentence
        assert check.verdict == "pass" or check.remedy


def test_other_data_that_disagrees_stops():
    agrees = {"verdict": "agrees", "sentence": "It holds."}
    against = {"verdict": "disagrees", "sentence": "The camera has turned."}
    unknown = {"verdict": "unknown", "sentence": "Too few."}
    assert elsewhere([]).verdict == elsewhere([unknown]).verdict == "not_checked"
    assert elsewhere([unknown, agrees]).verdict == "pass"
    check = elsewhere([agrees, against, unknown])
    assert (check.verdict, check.sentence) == ("stop", "The camera has turned.")
    assert check.figures == {"agrees": 1, "disagrees": 1, "unknown": 1}


def test_tests_of_one_drive_that_contradict_each_other_give_no_verdict():
    """A sound simulated walk: edges said -0.81 and markers +0.92 degrees of pitch, +-0.02 each."""
    sigmas = {"sigma_pitch_deg": 0.02, "sigma_yaw_deg": 0.02}
    drive = sigmas | {
        "data": "a.bag",
        "recording_id": "1",
        "verdict": "disagrees",
        "sentence": "It turned.",
        "yaw_deg": 0,
    }
    edges, markers = drive | {"kind": "edges", "pitch_deg": -0.81}, drive | {"kind": "lanes", "pitch_deg": 0.92}
    check = elsewhere([markers, edges])
    assert check.verdict == "not_checked" and check.figures == {"agrees": 0, "disagrees": 0, "unknown": 2}
    assert check.sentence.startswith("Lane markers and depth edges of a.bag contradict each other")
    assert "+0.92 and -0.81 degrees of pitch" in check.sentence
    # Another drive decides, and what was seen on two drives is no contradiction: the camera may have moved between.
    assert elsewhere([markers, edges, {"verdict": "agrees", "sentence": "It holds."}]).verdict == "pass"
    assert elsewhere([markers, edges | {"recording_id": "2"}]).verdict == "stop"
    assert elsewhere([markers, edges | {"verdict": "unknown"}]).verdict == "stop"


def test_an_effect_is_graded_by_chance_and_size():
    assert graded(1e-4, Effect(2.0, 1.1, 0.4)) == "stop"
    assert graded(1e-4, Effect(2.0, 0.9, 0.6)) == graded(4e-3, Effect(9.0, 8.0, 0.5)) == "look"
    assert graded(1e-9, Effect(0.4, 0.3, 0.1)) == graded(0.01, Effect(9.0, 1.1, 4.0)) == "pass"


def test_few_pairs_without_degrees_of_freedom_have_numbers_in_every_check():
    document, pairs = real(5)
    run = read_run(fit_request(**document).model_dump(mode="json"), -1, pairs)
    for check in solved(run, run_search(run.problem)).checks:
        assert np.all(np.isfinite([value for value in check.figures.values() if value is not None])), check
