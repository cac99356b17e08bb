"""`apexcal simulate` is the simulator: its examples, what is said to it, and its refusals."""

import json

import pytest

from tests.apexcal.test_cli import program
from workers.simulation.options import EXAMPLES, options_of, parser


@pytest.mark.parametrize("line", [line for line in EXAMPLES.splitlines() if "apexcal simulate" in line])
def test_every_example_is_understood(line):
    options_of(parser().parse_args(line.split()[2:]))


def test_what_is_said_reaches_the_recording(tmp_path):
    words = ["--seconds", 1, "--camera-hz", 2, "--cameras", "front,left", "--format", "mcap"]
    done = program("simulate", "--out", tmp_path / "walk", *words, "--clock-offset-ms", -20, "--json")
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert (summary["format"], summary["sweeps"], summary["frames"]) == ("mcap", 10, 4)
    truth = json.loads((tmp_path / "walk" / "truth.json").read_text())
    assert truth["clock"]["offset_ns"] == -20_000_000
    assert list(truth["cameras"]) == ["front", "left"]


def test_a_refusal_names_the_value_and_no_program_behind_the_command(tmp_path):
    (tmp_path / "file").touch()
    refused = program("simulate", "--out", tmp_path / "file" / "below")
    assert refused.returncode == 2 and "not a directory" in refused.stderr
    assert not any(word in refused.stderr for word in ("Traceback", "python -m", "Errno"))
