"""The demo's judgement: what it takes for true, and when it says that something fell short."""

import io
import json
import subprocess
import sys
from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from scipy.spatial.transform import Rotation

from apexcal.demo import report
from apexcal.demo.__main__ import main
from apexcal.demo.annotators import BLUNDERS, NOISE_PX, _look
from apexcal.demo.real import find_data
from apexcal.demo.truth import Truth, project
from apexcal.documents.camera_models import MODELS
from apexcal.documents.correspondence_sets import PairView
from apexcal.documents.detections import VertexSummary
from apexcal.documents.marking import TaskFrame, TaskView
from apexcal.documents.transforms import SolvedRotation, SolvedTransform
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


@pytest.mark.parametrize("degrees", [0.0, 0.001, 0.5, 90.0, 179.0])
def test_errors_of_a_transform_are_its_angle_and_its_lever_arm(truth, degrees):
    turn = Rotation.from_rotvec(np.radians(degrees) * np.array([0.6, 0.0, 0.8])).as_matrix()
    off = truth.t + np.array([0.03, 0.0, 0.04])
    rotation = SolvedRotation(matrix=(turn @ truth.R).tolist(), quaternion_xyzw=[], euler=[])
    found = SolvedTransform(to_frame="camera", from_frame="lidar", rotation=rotation, translation_m=off.tolist())
    assert truth.errors_of(found) == pytest.approx((degrees, 0.05), abs=1e-6)


def test_annotators_click_the_truth_with_noise_and_reject_what_is_elsewhere(truth):
    stamp = next(stamp for stamp in truth._frames if truth.apex(stamp)[1])
    xyz, pixel = truth.apex(stamp)
    vertex = VertexSummary.model_construct(**dict(zip("xyz", xyz.tolist(), strict=True)))
    frame = TaskFrame.model_construct(stamp_ns=stamp, width=960, height=600)
    task = TaskView.model_construct(frame=frame, vertex=vertex)
    clicks = np.array([_look(task, truth, np.random.default_rng([0, k])) for k in range(2000)])
    away = np.linalg.norm(clicks - np.array(pixel), axis=1)
    assert np.median(away) == pytest.approx(NOISE_PX * 1.177, rel=0.1)
    assert np.mean(away > 8) == pytest.approx(BLUNDERS, abs=0.006)
    task.vertex = vertex.model_copy(update={"x": vertex.x + 1.0})
    assert _look(task, truth, np.random.default_rng(0)) is None


FIGURES = {
    **{f"{stage}_{kind}": 1.0 for stage in ("ga", "polished", "baseline") for kind in ("px", "rms_px")},
    "heldout_px": 1.2,
    "seconds": 0.5,
}
SIMULATED = {**FIGURES, "heldout_truth_px": 1.1, "rotation_error_deg": 0.4, "translation_error_m": 0.01}
ACCEPTED = {"tolerant": 3, "refined": 15}
DETECTIONS = {
    "detections": {name: {"accepted": count, "sweeps": 20} for name, count in ACCEPTED.items()},
    "notes": ["a note"],
}
GOOD = {
    "simulated": {
        **{model: dict(SIMULATED) for model in MODELS},
        "model": "brown_conrady",
        "solve": {**SIMULATED, "pairs": 95, "verdict": "look", "file": "truck.calibrated.urdf"},
        "pairs": 100,
        "marks": 300,
        "workers_used": 2,
        **DETECTIONS,
    },
    "real": {**{model: dict(FIGURES) for model in MODELS}, "correspondences": 80, **DETECTIONS},
}


def changed(*path: str, to: float | None) -> dict:
    document = deepcopy(GOOD)
    place = document
    for name in path[:-1]:
        place = place[name]
    place[path[-1]] = to
    return document


def test_a_good_report_has_no_shortfall_with_or_without_real_data():
    assert report.shortfalls(GOOD) == []
    assert report.shortfalls({**GOOD, "real": {"skipped": "no data"}}) == []


@pytest.mark.parametrize(
    ("document", "says"),
    [
        (changed("simulated", "brown_conrady", "rotation_error_deg", to=1.1), "degrees off"),
        (changed("simulated", "brown_conrady", "heldout_px", to=1.7), "held-out"),
        (changed("simulated", "detections", "refined", "accepted", to=3), "no more sweeps"),
        (changed("simulated", "solve", "file", to=None), "wrote no URDF"),
        (changed("real", "pinhole", "polished_px", to=19.6), "pinhole"),
        (changed("real", "brown_conrady", "polished_px", to=4.4), "brown_conrady"),
    ],
)
def test_each_shortfall_is_a_sentence(document, says):
    (sentence,) = report.shortfalls(document)
    assert says in sentence


def test_the_table_fits_80_characters_and_loses_nothing():
    out = Console(width=80, file=io.StringIO())
    report.show(GOOD, out)
    table = out.file.getvalue().split("simulated: `tolerant`")[0]
    assert "…" not in table
    assert all(model in table for model in MODELS)
    rows = [line.split()[0] for line in table.splitlines() if line.strip()]
    below = rows.index(GOOD["simulated"]["model"])
    assert rows[below + 1 : below + 3] == ["solve", "(its"] and "(the truth)" in table


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
        done = subprocess.run([sys.executable, "-m", "apexcal.demo"], cwd=home, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr
        reports.append(json.loads((home / "var" / "demo" / "report.json").read_text()))
    for model in MODELS:
        for figure in ("ga_px", "polished_px", "baseline_px", "heldout_px", "rotation_error_deg"):
            assert reports[0]["simulated"][model][figure] == reports[1]["simulated"][model][figure]
    if find_data(REPOSITORY):
        assert reports[0]["real"]["correspondences"] == 80
