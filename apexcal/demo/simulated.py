"""First half: a simulated recording whose truth is known, marked by three people, calibrated on farmed slots."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np

from apexcal.client import Client
from apexcal.commands.calibrate import calibrate
from apexcal.commands.detect import detect
from apexcal.commands.recordings import upload
from apexcal.demo import report
from apexcal.demo.annotators import NAMES, mark_everything
from apexcal.demo.steps import DemoSession, DemoSteps
from apexcal.demo.truth import Truth
from apexcal.documents.calibrations import CalibrationView
from apexcal.documents.detections import DetectionView
from apexcal.documents.fleets import FleetOut
from apexcal.errors import ClientError
from apexcal.rigs import read_rig
from apexcal.transport import Document

CAMERA = "front"
SECONDS = 120
FOLDS = 5


def simulate(steps: DemoSteps, folder: Path) -> None:
    """Write the recording, its truth and its rig into a new folder, by the simulator's own command."""
    with steps.step("simulated", "simulate") as on_progress:
        command = [sys.executable, "-m", "workers.simulation", "--out", str(folder), "--seconds", str(SECONDS)]
        with subprocess.Popen([*command, "--progress-json"], stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            for line in process.stdout:
                progress = json.loads(line)
                if progress.get("stage") == "recording":
                    on_progress(progress["done"] / progress["total"], f"{SECONDS} s of VLP-16 and camera")
        if process.returncode != 0:
            raise ClientError("the simulator failed", "What it said stands above.")
        size = (folder / "recording.bag").stat().st_size
        on_progress(1.0, f"a ROS 1 bag of {size / 1e6:.0f} MB")


def run(session: DemoSession, fleet: FleetOut, folder: Path) -> Document:
    """From the bag to results: the ``simulated`` part of the report."""
    truth, client = Truth(folder / "truth.json"), session.client
    vehicle = client.vehicles.create(fleet.id, "Simulated vehicle")
    client.vehicles.create_rig(vehicle.id, read_rig(folder / "rig.json", "Front camera"))
    bag, on, name = folder / "recording.bag", str(vehicle.id), "Walk with a board"
    recording = session.run("upload and ingest", upload, bag, vehicle=on, name=name, marks=len(NAMES))
    of, region = str(recording.id), folder / "region.json"
    preview = session.run("region of interest", detect, of, region=region, preview=True)
    strict = session.run("detect (strict)", detect, of, region=region, detector="strict")
    tolerant = session.run("detect (tolerant)", detect, of, region=region, detector="tolerant")
    refined = session.run("detect (refined)", detect, of, region=region, interpolate=True)
    with session.step("three people mark") as on_progress:
        progress, tally = mark_everything(client, fleet.id, tolerant, CAMERA, truth, on_progress)
        on_progress(1.0, f"{tally.marks} marks on {progress.complete} vertices, {tally.rejected} rejections")
    from_marks = {"detection": str(tolerant.id), "folds": FOLDS, "farm": "slots", "publish": True}
    calibration = session.run("calibrate", calibrate, **from_marks)
    summary = report.summary_of(calibration, CAMERA)
    # A result that does not pass its checks does not publish itself.
    current = str(client.calibrations.current(vehicle.id, CAMERA).result_id) if summary.published else None
    return {
        **judge(client, truth, calibration),
        "refined": _with_refined(session, truth, refined),
        "model": truth.model,
        "detections": report.acceptance([strict, tolerant, refined]),
        "region": preview.result.model_dump(include={"frames", "frames_kept", "points", "points_kept"}),
        "marks": tally.marks,
        "notes": calibration.notes,
        "recording_id": of,
        "detection_id": str(tolerant.id),
        "calibration_id": str(calibration.id),
        "current": current,
        "checks": [check.model_dump() for check in summary.checks if check.verdict != "pass"],
    }


def _with_refined(session: DemoSession, truth: Truth, refined: DetectionView) -> Document:
    """The true model once more, from refined vertices that were moved to their frames' times, with the same marks."""
    calibration = session.run(
        "calibrate (refined)", calibrate, detection=str(refined.id), model=[truth.model], folds=FOLDS
    )
    figures = judge(session.client, truth, calibration)
    return figures[truth.model] | {"pairs": figures["pairs"]}


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
