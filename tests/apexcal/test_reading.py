"""What an owner knows of a file: options in, questions back."""

import pytest
from typer.testing import CliRunner

from apexcal.cli import USAGE, app
from apexcal.client import ClientError, time_left
from apexcal.commands.detect import _board
from apexcal.commands.reading import reading_of, which_is_which
from apexcal.commands.reread import _added


def test_topics_become_the_reading():
    assert reading_of(None) == {}
    assert reading_of(["lidar=/points", "front = /cam/a"], still=True, lidar_model="vlp16", rings=16) == {
        "point_times": "stamp_only",
        "lidar_model": "vlp16",
        "rings": 16,
        "topics": {"lidar": "/points", "cameras": {"front": "/cam/a"}},
    }


@pytest.mark.parametrize("text", ["front", "=x", "front="])
@pytest.mark.parametrize("words", [["upload", "walk.bag", "--vehicle", "R1"], ["reread", "walk"]])
def test_a_topic_without_a_name_is_wrong_usage(words, text):
    shown = CliRunner().invoke(app, [*words, "--topic", text])
    assert (shown.exit_code, type(shown.exception)) == (USAGE, SystemExit)
    assert f"--topic {text!r} names no topic" in shown.stderr and "--topic front=/camera/image" in shown.stderr


def test_what_is_said_later_is_added():
    before = {"rate_hz": 10.0, "topics": {"lidar": "/a", "cameras": {"front": "/b"}}}
    known = {"rings": 16, "topics": {"cameras": {"rear": "/c"}}}
    assert _added(before, known) == {
        "rate_hz": 10.0,
        "rings": 16,
        "topics": {"lidar": "/a", "cameras": {"front": "/b", "rear": "/c"}},
    }
    assert _added({}, {"rings": 16}) == {"rings": 16}


def test_candidates_are_listed_with_the_command_that_answers():
    candidates = [
        {"name": "/points", "kind": "lidar", "count": 1200},
        {"name": "/cam/b", "kind": "camera", "count": None, "width": 1280, "height": 720},
    ]
    said = which_is_which({"code": "ambiguous_cameras", "candidates": candidates})
    assert "/points  (1200 messages)" in said and "/cam/b  (1280 x 720 pixels)" in said
    assert said.endswith("apexcal reread RECORDING --topic NAME=/cam/b")
    assert which_is_which({"code": "recording_truncated"}) == which_is_which(None) == ""


def test_the_boards_size_is_two_edges():
    assert _board("0.61x0.91") == {"board_width_m": 0.61, "board_height_m": 0.91}
    assert _board("") == {}
    for text in ("0.61", "a x b", "1x2x3"):
        with pytest.raises(ClientError, match="no size of a board"):
            _board(text)


@pytest.mark.parametrize(
    ("seconds", "said"),
    [(1, "5 s"), (42, "40 s"), (100, "2 min"), (3000, "50 min"), (9000, "2.5 h")],
)
def test_time_left_is_said_roughly(seconds, said):
    assert time_left(seconds) == f"about {said} left"
