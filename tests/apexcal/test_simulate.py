"""The command offers what the simulator takes, says it in groups, and starts it with what was said."""

import importlib
import json
import subprocess
import sys
from typing import Literal, get_args, get_origin

import pytest
from typer.main import get_command
from typer.testing import CliRunner

from apexcal.cli import app
from workers.simulation.options import parser


@pytest.fixture(scope="module")
def command():
    root = get_command(app)
    context = root.make_context("apexcal", ["simulate", "--help"], resilient_parsing=True)
    return root.resolve_command(context, ["simulate"])[1]


def choices(annotation):
    return get_args(annotation) if get_origin(annotation) is Literal else ()


def offered(command):
    """Name of each option -> default and choices, without those that only the command has."""
    return {
        parameter.opts[-1]: (parameter.default, choices(parameter.type_descriptor.annotation))
        for parameter in command.params
        if parameter.opts[-1] not in ("--out", "--json")
    }


def test_the_command_offers_what_the_simulator_takes(command):
    taken = {
        action.option_strings[0]: (action.default, tuple(action.choices or ()))
        for action in parser()._actions
        if action.option_strings[0] not in ("-h", "--out", "--json", "--progress-json")
    }
    assert offered(command) == taken


def test_help_is_grouped_and_ends_with_examples():
    shown = CliRunner().invoke(app, ["simulate", "--help"]).stdout
    headings = [line for line in shown.splitlines() if line.endswith(":") and not line.startswith(" ")]
    assert headings == [
        "Recording:", "LiDAR:", "Cameras:", "Walk:", "What is in the way:", "Other:", "Examples:",
    ]  # fmt: skip
    assert "apexcal simulate --out walk\n" in shown


def test_every_example_is_understood(command):
    examples = importlib.import_module("apexcal.commands.simulate").EXAMPLES
    lines = [line.split() for line in examples.splitlines() if line.startswith("apexcal simulate")]
    assert len(lines) >= 4
    for _, _, *words in lines:
        command.make_context("simulate", list(words))  # exits where it is not understood
        parser().parse_args(words)


def test_what_is_said_reaches_the_recording(tmp_path):
    words = ["simulate", "--out", tmp_path / "walk", "--seconds", "1", "--camera-hz", "2", "--cameras", "front,left",
             "--format", "folder", "--clock-offset-ms", "-20", "--json"]  # fmt: skip
    done = subprocess.run([sys.executable, "-m", "apexcal.cli", *map(str, words)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    written = json.loads(done.stdout)
    assert (written["format"], written["sweeps"], written["frames"]) == ("folder", 10, 4)
    truth = json.loads((tmp_path / "walk" / "truth.json").read_text())
    assert truth["clock"]["offset_ns"] == -20_000_000
    assert list(truth["cameras"]) == ["front", "left"]


def test_a_refusal_names_the_value(tmp_path):
    words = ["simulate", "--out", tmp_path / "x", "--cameras", "rear"]
    done = subprocess.run([sys.executable, "-m", "apexcal.cli", *map(str, words)], capture_output=True, text=True)
    assert done.returncode == 2
    assert "rear:DEGREES" in done.stderr
    assert "Traceback" not in done.stderr
