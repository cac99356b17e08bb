"""``apexcal solve``: a recording, a rig and a board's size become a file."""

import json
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from apexcal.demo.truth import Truth
from tests.apexcal.test_cli import apexcal


def test_nobody_is_passed_over_without_being_told(simulated, tmp_path):
    words = ("solve", simulated / "recording.bag", "--rig", simulated / "rig.json", "-o", tmp_path / "out.urdf")
    refused = apexcal(*words, "--data", tmp_path / "data")
    assert refused.returncode == 2 and "--machine-marks" in refused.stderr
    (tmp_path / "out.urdf").write_text("mine")
    kept = apexcal(*words, "--machine-marks", "--data", tmp_path / "data")
    assert kept.returncode == 2 and (tmp_path / "out.urdf").read_text() == "mine"
    assert not (tmp_path / "data").exists(), "no service was started for nothing"


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_walk_becomes_a_urdf_that_nobody_marked(embedded, tmp_path):
    walk, out = tmp_path / "walk", tmp_path / "out.urdf"
    command = [sys.executable, "-m", "workers.simulation", "--out", str(walk), "--seconds", "90"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    board = json.loads((walk / "truth.json").read_text())["settings"]["board"]
    words = (
        "solve",
        walk / "recording.bag",
        "--rig",
        walk / "rig.json",
        "--board",
        board,
        "--machine-marks",
        "--fleet",
        "S",
    )
    done = apexcal(*words, "-o", out, "--data", embedded.data, "--json")
    assert done.returncode == 0, done.stderr
    (camera,) = json.loads(done.stdout)["summary"]["cameras"].values()
    doubts = {check["name"]: check["verdict"] for check in camera["checks"] if check["verdict"] != "pass"}
    assert doubts == {"marks_confirmed": "look"}
    origin = next(ElementTree.parse(out).getroot().iter("origin"))
    truth = Truth(walk / "truth.json")
    place_m = np.array([float(value) for value in origin.attrib["xyz"].split()])
    assert np.linalg.norm(place_m + truth.R.T @ truth.t) < 0.015
