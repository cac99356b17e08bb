"""What an owner knows of a file: options in, questions back."""

import pytest
from typer.testing import CliRunner

from apexcal.cli import app
from apexcal.client import time_left
from apexcal.commands.clock_offset import _outcome
from apexcal.commands.detect import _outcome as _detected
from apexcal.commands.detect import board_options
from apexcal.commands.recordings import candidates_of, merged_reading, reading_of
from apexcal.commands.terminal import USAGE
from apexcal.documents.analyses import ClockOffset
from apexcal.documents.detections import DetectionCounts, DetectionView, Pairing, SizeSeen
from apexcal.documents.detectors import DETECTORS, sentences_of


def test_topics_become_the_reading():
    assert reading_of(None) == {}
    assert reading_of(["lidar=/points", "front = /cam/a"], still=True, lidar_model="vlp16", rings=16) == {
        "point_times": "stamp_only",
        "lidar_model": "vlp16",
        "rings": 16,
        "topics": {"lidar": "/points", "cameras": {"front": "/cam/a"}},
    }


@pytest.mark.parametrize("text", ["front", "=x", "front="])
@pytest.mark.parametrize("words", [["upload", __file__, "--vehicle", "R1"], ["reread", "walk"]])
def test_a_topic_without_a_name_is_wrong_usage(words, text):
    shown = CliRunner().invoke(app, [*words, "--topic", text])
    assert (shown.exit_code, type(shown.exception)) == (USAGE, SystemExit)
    assert f"--topic {text!r} is not NAME=VALUE" in shown.stderr and "--topic front=/camera/image" in shown.stderr


def test_what_is_said_later_ismerged_reading():
    before = {"rate_hz": 10.0, "topics": {"lidar": "/a", "cameras": {"front": "/b"}}}
    known = {"rings": 16, "topics": {"cameras": {"rear": "/c"}}}
    assert merged_reading(before, known) == {
        "rate_hz": 10.0,
        "rings": 16,
        "topics": {"lidar": "/a", "cameras": {"front": "/b", "rear": "/c"}},
    }
    assert merged_reading({}, {"rings": 16}) == {"rings": 16}


def test_candidates_are_listed_with_the_command_that_answers():
    candidates = [
        {"name": "/points", "kind": "lidar", "count": 1200},
        {"name": "/cam/b", "kind": "camera", "count": None, "width": 1280, "height": 720},
    ]
    said = candidates_of({"code": "ambiguous_cameras", "candidates": candidates})
    assert "/points  (1200 messages)" in said and "/cam/b  (1280 x 720 pixels)" in said
    assert said.endswith("apexcal reread RECORDING --topic NAME=/cam/b")
    assert candidates_of({"code": "recording_truncated"}) == candidates_of(None) == ""


def test_the_boards_size_is_two_edges():
    assert board_options("0.61x0.91", "tip") == {"board_width_m": 0.61, "board_height_m": 0.91}
    assert board_options("", "tip", "strict") == {}


@pytest.mark.parametrize(
    ("words", "sentence", "advice"),
    [
        *((["--board", text], "no size of a board", "0.61x0.91") for text in ("0.61", "a x b", "1x2x3", "nanx1")),
        *(
            (["--board", text], "metres, each from 0.1 to 3", "leave it out")
            for text in ("0x0", "61x91", "0.61x0.05")
        ),
        *((["--board", "1x1", "--detector", name], f"{name} does not use", "") for name in ("strict", "tolerant")),
        (["--corner", "upper-left"], "needs the board's size", "--board 0.61x0.91"),
        (["--option", "x"], "is no option", "max_sigma_deg"),
        (["--option", "x", "--detector", "tolerant"], "is no option", "min_points"),
        (["--option", "x", "--detector", "strict"], "is no option", "min_ring_span"),
    ],
)
def test_what_the_detector_cannot_take_is_wrong_usage(words, sentence, advice):
    shown = CliRunner().invoke(app, ["detect", "walk", "--keep", "range < 9", *words])
    assert shown.exit_code == USAGE
    assert sentence in shown.stderr and advice in shown.stderr


def test_a_region_is_not_replaced_unasked(tmp_path):
    out = tmp_path / "region.json"
    out.write_text("{}")
    shown = CliRunner().invoke(app, ["suggest", "walk", "--out", str(out)])
    assert shown.exit_code == USAGE and "--force" in shown.stderr
    assert out.read_text() == "{}"


def test_an_offset_is_said_with_the_command_that_uses_it():
    result = ClockOffset.model_construct(offset_ns=-30_200_000, sigma_ns=1_100_000, pairs=90, rms_px=1.4)
    options = {"board_width_m": 0.61, "board_height_m": 0.91, "track": 1}
    pairing = Pairing(offset_ns=0, max_gap_ns=50_000_000, mode="interpolate")
    known = {"recording_id": "R", "detector": "refined", "options": options}
    detection = DetectionView.model_construct(**known, pairing=pairing)
    said = _outcome(result, detection, "front")
    assert (
        "apexcal detect R --region REGION.json --detector refined --board 0.61x0.91 --option track=1 --interpolate "
        "--offset-ms -30.200\n"
    ) in said
    small = result.model_copy(update={"offset_ns": 1_000_000})
    assert _outcome(small, detection, "front").endswith("agree within the error: no offset is needed.")
    moved = DetectionView.model_construct(**known, pairing=pairing.model_copy(update={"offset_ns": 9_000_000}))
    assert "offset of 9 ms" in (again := _outcome(small, moved, "front")) and "--offset-ms 0.000" in again


@pytest.mark.parametrize(
    ("seconds", "said"),
    [(1, "5 s"), (42, "40 s"), (100, "2 min"), (3000, "50 min"), (9000, "2.5 h")],
)
def test_time_left_is_said_roughly(seconds, said):
    assert time_left(seconds) == f"about {said} left"


def test_reasons_say_what_to_change():
    """A reason of an older version is said by its name alone."""
    reasons = sentences_of("refined", ["never_shown", "of_old"], {}, {})
    counts = DetectionCounts(sweeps=8, accepted=2, paired=2, rejected={"never_shown": 5, "of_old": 1})
    detection = DetectionView.model_construct(id="d", counts=counts, options={}, detector="refined", reasons=reasons)
    said = _detected(detection)
    assert "5 without: never shown: the near sweeps of this recording do not show a board" in said
    assert "State the board's size" in said
    assert "1 without: of old" in said.splitlines()[-1]


def test_what_is_not_as_the_owner_said_is_said():
    seen = SizeSeen(seen_m=(0.88, 1.199), sigma_m=(0.011, 0.011), contradicts=True, replaces=True)
    counts = DetectionCounts(sweeps=8, accepted=2, paired=2, poses=8, poses_stated=True, size=seen)
    options = {"board_width_m": 1.2, "board_height_m": 0.9}
    detection = DetectionView.model_construct(id="d", counts=counts, options=options, detector="refined")
    said = _detected(detection)
    assert "looks like 0.880 x 1.199 m (+- 0.011); you said 0.900 x 1.200 m" in said
    assert "somebody walks" not in said
    assert "used the size that the board shows" in said
    detection.counts = counts.model_copy(update={"size": seen.model_copy(update={"replaces": False})})
    assert "you said 0.900 x 1.200 m, and that was used" in _detected(detection)
    agrees = seen.model_copy(update={"contradicts": False, "replaces": False})
    detection.counts = counts.model_copy(update={"size": agrees})
    assert "0.880 x 1.199 m (+- 0.011); the stated 0.900 x 1.200 m agree" in _detected(detection)
    detection.options = {"board_width_m": 0.0, "board_height_m": 0.0}
    assert "No size was stated" in _detected(detection)
    detection.counts = counts.model_copy(update={"size": None, "poses_walked": True})
    said = _detected(detection)
    assert "looks like" not in said
    assert "somebody walks in the recording" in said and "without --still" in said


def test_reasons_speak_of_the_corner_and_advise_no_option_that_was_stated() -> None:
    sized = {"board_width_m": 0.6, "board_height_m": 0.9}
    names = DETECTORS["refined"].reasons
    plain = sentences_of("refined", names, {}, {})
    assert "`--corner`" in plain["upright_object"] and "state the board's size" in plain["too_uncertain"]
    stated = sentences_of("refined", names, {}, sized)
    assert not any(
        "the board's size." in stated[name] or "state the board's size" in stated[name]
        for name in names
        if name != "size_not_stated"
    )
    corner = sentences_of("refined", names, {}, sized | {"upper_corner": 1})
    for name in set(names) - {"size_not_stated", "nothing_differs", "off_the_track"}:
        assert "--corner" not in corner[name] and "--board" not in corner[name] and " tip" not in corner[name]
    assert "four rings" in corner["too_few_rings"] and "5 to 10 degrees" in corner["too_uncertain"]
