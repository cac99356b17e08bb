"""The demo: what it takes for true, and its whole form."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from apexcal.documents.camera_models import DEFAULT_MODELS as MODELS
from apexcal.documents.correspondence_sets import PairView
from benchmarks.demo.__main__ import main
from benchmarks.demo.real import find_data
from benchmarks.demo.truth import Truth, project
from workers.geometry.models import INTRINSICS
from workers.geometry.projection import project as project_exactly

REPOSITORY = Path(__file__).parents[2]
VALUES = {
    "f_x": 700,
    "f_y": 690,
    "c_x": 480,
    "c_y": 300,
    "skew": 0.02,
    "k1": -0.2,
    "k2": 0.05,
    "k3": 1e-3,
    "k4": 2e-3,
}


@pytest.fixture(scope="module")
def truth(simulated):
    return Truth(simulated / "truth.json")


@pytest.mark.parametrize("model", MODELS)
def test_the_truth_projects_as_the_workers_do(model):
    intrinsics = {"model": model, **{name: VALUES.get(name, 0.0) for name in INTRINSICS[model]}}
    points = np.random.default_rng(1).uniform([-3, -2, 4], [3, 2, 12], (200, 3))
    pixels, violation = project_exactly(model, intrinsics, points)
    assert (violation <= 0).all()
    assert np.abs(project(intrinsics, points) - pixels).max() < 1e-6


def test_the_truth_projects_its_apex_to_its_pixel(truth, simulated):
    frames = json.loads((simulated / "truth.json").read_text())["frames"]
    pairs = [
        PairView.model_validate(dict(zip("xyzuv", (*xyz, *uv), strict=True)))
        for xyz, uv, seen in zip(frames["apex_xyz"], frames["apex_uv"], frames["apex_in_image"], strict=True)
        if seen
    ]
    assert truth.errors_px(pairs).max() < 0.01


def test_help_runs_nothing(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["demo", "--help"])
    with pytest.raises(SystemExit) as left:
        main()
    assert left.value.code == 0
    assert "var/demo/report.json" in capsys.readouterr().out
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_the_whole_demo_twice(tmp_path):
    """As `make demo` runs it, in a folder of its own; the same figures each time."""
    home = tmp_path / "main"
    home.mkdir()
    if find_data(REPOSITORY):
        (tmp_path / "shared").symlink_to(REPOSITORY.parent / "shared")
    reports = []
    for _ in range(2):
        done = subprocess.run([sys.executable, "-m", "benchmarks.demo"], cwd=home, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr
        reports.append(json.loads((home / "var" / "demo" / "report.json").read_text()))
    for model in MODELS:
        for figure in ("ga_px", "polished_px", "baseline_px", "heldout_px", "rotation_error_deg"):
            assert reports[0]["simulated"][model][figure] == reports[1]["simulated"][model][figure]
    if find_data(REPOSITORY):
        assert reports[0]["real"]["correspondences"] == 80
