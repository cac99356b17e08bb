"""``apexcal solve``: a recording and a board's size become a file. What the recording does not say is asked."""

import json
import os
import pty
import re
import select
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Reader
from rosbags.typesys import get_types_from_msg

from apexcal.commands.solve import _left_undone
from apexcal.geometry.frame_tree import urdf_tree
from apexcal.processes import die_with, tied_to_this
from benchmarks.demo.truth import Truth
from tests.apexcal.test_cli import apexcal
from tests.apexcal.test_inspection import TYPES, shifted, write
from tests.apexcal.test_rectified_images import mark
from tests.support import walks
from tests.support.asking import leave_marks_to_people
from tests.support.served import Embedded

COMMAND = (sys.executable, "-m", "apexcal.cli", "solve")


def test_what_neither_recording_nor_options_say_is_asked_by_the_option_that_answers(simulated, tmp_path):
    """Nobody is at the terminal, and the simulated recording has no tree of frames."""
    words = ("solve", simulated / "recording.bag", "-o", tmp_path / "out.urdf", "--data", tmp_path / "data")
    asked = apexcal(*words)
    assert asked.returncode == 2 and "--looks front=" in asked.stderr and "--rig" in asked.stderr
    assert "forward, left, backward, right" in asked.stderr and "Traceback" not in asked.stderr
    wrong = apexcal(*words, "--looks", "front=forward", "--camera", "rear")
    assert wrong.returncode == 2 and "no camera 'rear'" in wrong.stderr and "front" in wrong.stderr
    refused = apexcal(*words, "--corner", "upper-left", "--machine-marks")
    assert refused.returncode == 2 and "needs the board's size" in refused.stderr
    assert "Traceback" not in refused.stderr
    assert "front" not in refused.stderr, "the recording was read first"
    (tmp_path / "out.urdf").write_text("mine")
    kept = apexcal(*words, "--looks", "front=forward")
    assert kept.returncode == 2 and (tmp_path / "out.urdf").read_text() == "mine"
    assert not (tmp_path / "data").exists(), "no service was started for nothing"


def test_a_person_at_the_terminal_is_asked_only_what_the_file_does_not_say(simulated, tmp_path):
    """The wrong camera ends the command after its question, and before it starts a service."""
    words = (str(simulated / "recording.bag"), "-o", str(tmp_path / "out.urdf"), "--camera", "rear")
    terminal, inside = pty.openpty()
    with subprocess.Popen(
        [*COMMAND, *words], stdin=inside, stdout=inside, stderr=inside, preexec_fn=tied_to_this()
    ) as process:
        os.close(inside)
        shown = until(terminal, "Where does front look")
        os.write(terminal, b"up\n")
        shown += until(terminal, "none of these")
        os.write(terminal, b"left\n")
        shown += until(terminal, "no camera 'rear'")
        assert process.wait() == 2
    os.close(terminal)
    assert "forward" in shown and "LiDAR is" not in shown and "Which" not in shown


def test_advice_names_only_what_was_not_done():
    assert _left_undone(board="0.6x0.9", has_lens=True, machine_marks=False) == []
    size, lens, person = _left_undone(board="", has_lens=False, machine_marks=True)
    assert "--board" in size and "--intrinsics" in lens and "--machine-marks" in person


def until(terminal: int, text: str, within_s: float = 120.0) -> str:
    """What a program prints on a terminal up to this text."""
    shown, end = "", time.monotonic() + within_s
    while text not in shown:
        assert select.select([terminal], [], [], max(0.0, end - time.monotonic()))[0], f"{text!r} is not in {shown!r}"
        shown += os.read(terminal, 4096).decode()
    return shown


@pytest.mark.slow
def test_a_walk_becomes_the_vehicles_urdf_that_nobody_marked(embedded, tmp_path):
    walk, out = tmp_path / "walk", tmp_path / "out.urdf"
    command = [sys.executable, "-m", "workers.simulation", "--out", str(walk), "--seconds", "90"]
    subprocess.run([*command, "--camera-info", "raw"], check=True, stdout=subprocess.DEVNULL)
    board = json.loads((walk / "truth.json").read_text())["settings"]["board"]
    words = ("solve", walk / "recording.bag", "--urdf", walk / "vehicle.urdf", "--board", board, "--machine-marks")
    done = apexcal(*words, "--fleet", "S", "-o", out, "--data", embedded.data, "--json")
    assert done.returncode == 0, done.stderr
    (camera,) = json.loads(done.stdout)["summary"]["cameras"].values()
    doubts = {check["name"]: check["verdict"] for check in camera["checks"] if check["verdict"] in ("look", "stop")}
    assert doubts == {"marks_confirmed": "look"}
    assert distance_m(out, walk) < 0.015
    nominal = distance_m(walk / "vehicle.urdf", walk)
    assert nominal > 0.02, "it was not there before"


def distance_m(urdf: Path, walk: Path) -> float:
    """How far from its true place a URDF has the camera, as seen from the LiDAR, metres."""
    truth = Truth(walk / "truth.json")
    T = urdf_tree(urdf.read_bytes()).transform("velodyne", "camera_front_optical")
    return float(np.linalg.norm(T.t + truth.R.T @ truth.t))


@pytest.fixture
def short() -> Path:
    return walks.walk("with-tree")


def words_of(walk: Path, served: Embedded, fleet: str, out: Path) -> tuple[str, ...]:
    named = ("--board", "0.6096x0.9144", "--fleet", fleet, "--data", str(served.data))
    return str(walk / "recording.bag"), *named, "-o", str(out)


def test_who_stops_before_there_are_marks_is_told_how_to_go_on(embedded: Embedded, owner, simulated, tmp_path):
    out = tmp_path / "out.urdf"
    with started(*words_of(simulated, embedded, "Stopped", out), "--looks", "front=forward") as solving:
        detection, camera = waits_at(solving)
        solving.send_signal(signal.SIGINT)
        _, printed = solving.communicate()
        assert solving.returncode == 130 and not out.exists()
    assert f"apexcal calibrate --detection {detection} --camera {camera}" in printed and "Traceback" not in printed
    leave_marks_to_people(owner, owner.detections.get(detection).recording_id)


@pytest.mark.slow
def test_frames_of_another_clock_are_paired_with_the_offset_that_their_recording_tells(
    embedded, owner, short, tmp_path
):
    """The camera counts from its start: 1,700,000,000 s behind. With its own clock no frame is near a sweep."""
    apart_s = 1_700_000_000
    with Reader(short / "recording.bag") as bag:
        for each in bag.connections:
            if each.msgtype not in TYPES.types:
                TYPES.register(get_types_from_msg(each.msgdef.data, each.msgtype))
        messages = [(each.topic, each.msgtype, time, bytes(raw)) for each, time, raw in bag.messages()]
    walk = tmp_path / "walk"
    walk.mkdir()
    edit = shifted(-apart_s, 0)
    write(walk / "recording.bag", [changed for message in messages for changed in edit(message)])
    with started(*words_of(walk, embedded, "Apart", tmp_path / "out.urdf"), "--yes") as solving:
        detection, _ = waits_at(solving)
        solving.send_signal(signal.SIGINT)
        solving.communicate()
    run = owner.detections.get(detection)
    assert abs(run.pairing.offset_ns + apart_s * 10**9) < 50_000_000
    assert run.counts.accepted and run.counts.paired > 0.4 * run.counts.accepted, "the camera has half the rate"


@pytest.mark.slow
def test_it_goes_on_once_a_person_has_marked_and_takes_the_same_rig_again(embedded, owner, short, tmp_path):
    for attempt in ("first", "second"):
        out = tmp_path / f"{attempt}.urdf"
        with started(*words_of(short, embedded, "Marked", out)) as solving:
            detection, _ = waits_at(solving)
            mark(owner, detection, Truth(short / "truth.json"))
            shown, printed = solving.communicate()
            # 4: a check said stop, for 12 s are little.
            assert (solving.returncode, out.exists()) in ((0, True), (4, False)), printed
        assert "Verdict on" in shown
    fleet = next(each for each in owner.fleets.list() if each.name == "Marked")
    (vehicle,) = owner.vehicles.list(fleet.id)
    assert len(list(owner.vehicles.rigs(vehicle.id))) == 1


def started(*words: str) -> subprocess.Popen[str]:
    pipes = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen(
        [*COMMAND, *words], **pipes, text=True, preexec_fn=partial(_as_from_a_terminal, os.getpid())
    )


def _as_from_a_terminal(parent: int) -> None:
    """Tests that run in the background ignore Ctrl-C, and what they start would, too."""
    die_with(parent)
    signal.signal(signal.SIGINT, signal.default_int_handler)


def waits_at(process: subprocess.Popen[str]) -> tuple[str, str]:
    """The detection and the camera of the page at which a person is to mark."""
    for line in process.stderr:
        if match := re.search(r"/detections/([0-9a-f-]{36})/(?:mark|crops)\?camera=(\w+)", line):
            return match[1], match[2]
    raise AssertionError(f"it ended with {process.wait()} before anybody was asked")
