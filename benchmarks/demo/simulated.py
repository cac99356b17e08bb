"""First half: a simulated recording whose truth is known, solved in one command, then marked by three people."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np

from apexcal.client import Client
from apexcal.commands.calibrate import calibrate
from apexcal.commands.detect import detect
from apexcal.commands.solve import solve
from apexcal.documents.calibrations import CalibrationView
from apexcal.documents.fleets import FleetOut
from apexcal.errors import ClientError
from apexcal.transport import Document
from benchmarks.demo import report
from benchmarks.demo.annotators import NAMES, mark_everything
from benchmarks.demo.steps import DemoSession, DemoSteps
from benchmarks.demo.truth import Truth

CAMERA = "front"
SECONDS = 45
# As the simulated walker carries it (`apexcal simulate --help`).
BOARD = "0.6096x0.9144"
FOLDS = 5


def simulate(steps: DemoSteps, folder: Path) -> None:
    """Write the recording, its truth and its vehicle's URDF into a new folder, by the simulator's own command."""
    with steps.step("simulated", "simulate") as on_progress:
        command = [sys.executable, "-m", "workers.simulation", "--out", str(folder), "--seconds", str(SECONDS)]
        with subprocess.Popen(
            [*command, "--camera-info", "raw", "--progress-json"], stdout=subprocess.PIPE, text=True
        ) as process:
            assert process.stdout is not None
            for line in process.stdout:
                progress = json.loads(line)
                if progress.get("stage") == "recording":
                    on_progress(progress["done"] / progress["total"], f"{SECONDS} s of VLP-16 and camera")
        if process.returncode != 0:
            raise ClientError("the simulator failed", "What it said stands above.")
        size = (folder / "recording.bag").stat().st_size
        on_progress(1.0, f"a ROS 1 bag of {size / 1e6:.0f} MB")


def run(session: DemoSession, fleet: FleetOut, folder: Path, output: Path) -> Document:
    """From the bag to a URDF by one command, then to results by people: the ``simulated`` part of the report."""
    truth, client = Truth(folder / "truth.json"), session.client
    bag = (folder / "recording.bag").rename(folder / "walk.bag")
    as_typed = {"urdf": folder / "vehicle.urdf", "board": BOARD, "machine_marks": True}
    solved = session.run("solve", solve, bag, output=output, fleet=fleet.name, force=True, **as_typed)
    machine = client.correspondence_sets.get(solved.request.correspondence_set_ids[0])
    assert machine.recording_id and machine.detection_id
    recording = client.recordings.get(machine.recording_id)
    client.recordings.edit(recording, marks_per_vertex=len(NAMES))
    of, region = str(recording.id), folder / "region.json"
    tolerant = session.run("detect (tolerant)", detect, of, region=region, detector="tolerant")
    with session.step("three people mark") as on_progress:
        progress, tally = mark_everything(client, fleet.id, tolerant, CAMERA, truth, on_progress)
        on_progress(1.0, f"{tally.marks} marks on {progress.complete} vertices, {tally.rejected} rejections")
    from_marks = {"detection": str(tolerant.id), "folds": FOLDS, "farm": "slots", "publish": True}
    calibration = session.run("calibrate", calibrate, **from_marks)
    summary = report.summary_of(calibration, CAMERA)
    # A result that does not pass its checks does not publish itself.
    vehicle = recording.vehicle_id
    current = str(client.calibrations.current(vehicle, CAMERA).result_id) if summary.published else None
    return {
        **judge(client, truth, calibration),
        "solve": _solved(client, truth, solved, output),
        "model": truth.model,
        "detections": report.acceptance([tolerant, client.detections.get(machine.detection_id)]),
        "marks": tally.marks,
        "notes": calibration.notes,
        "recording_id": of,
        "detection_id": str(tolerant.id),
        "calibration_id": str(calibration.id),
        "current": current,
        "checks": [check.model_dump() for check in summary.checks if check.verdict != "pass"],
    }


def _solved(client: Client, truth: Truth, calibration: CalibrationView, output: Path) -> Document:
    """The true model as `solve` has it from the machine's marks, and the file if it wrote one."""
    figures = judge(client, truth, calibration)
    verdict = report.summary_of(calibration, CAMERA).models[truth.model].verdict
    file = str(output) if output.is_file() else None
    return figures[truth.model] | {"pairs": figures["pairs"], "verdict": verdict, "file": file}


def judge(client: Client, truth: Truth, calibration: CalibrationView) -> Document:
    """Each model's figures with its errors against the truth, and what the truth itself would score.

    Every pair is held out once, so the true parameters' held-out error is their mean error on all pairs.
    """
    pairs = client.correspondence_sets.get(calibration.request.correspondence_set_ids[0])
    heldout_truth_px = float(np.mean(truth.errors_px(pairs.pairs)))
    models = report.figures(calibration, CAMERA)
    summary = report.summary_of(calibration, CAMERA).models
    workers = {worker for run in summary.values() for worker in run.workers}
    for name, figures in models.items():
        result = client.calibrations.result(summary[name].result_id)
        rotation_deg, translation_m = truth.errors_of(result.transform)
        figures |= {
            "heldout_truth_px": heldout_truth_px,
            "rotation_error_deg": rotation_deg,
            "translation_error_m": translation_m,
            "workers_used": len(set(summary[name].workers)),
        }
    return {**models, "pairs": pairs.count, "workers_used": len(workers)}
