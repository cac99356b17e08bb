"""The demo in its whole form."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from apexcal.documents.camera_models import DEFAULT_MODELS as MODELS
from benchmarks.demo.real import find_data

REPOSITORY = Path(__file__).parents[2]


@pytest.mark.slow
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
