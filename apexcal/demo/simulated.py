"""First half: a simulated recording whose truth is known, marked by three people, calibrated on farmed slots."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np

from apexcal.client import Client
from apexcal.demo import job
from apexcal.demo.annotators import NAMES, mark_everything
from apexcal.demo.steps import Steps
from apexcal.demo.truth import Truth
from apexcal.documents.calibrations import CalibrationView
from apexcal.documents.correspondence_sets import SetView
from apexcal.documents.detections import DetectionView
from apexcal.documents.fleets import FleetOut
from apexcal.documents.results import ResultView
from apexcal.errors import ClientError
from apexcal.regions import read_region
from apexcal.rigs import read_rig
from apexcal.transport import Document

HALF = "simulated"
CAMERA = "front"
SECONDS = 120
FOLDS = 5


def simulate(steps: Steps, folder: Path) -> None:
    """Write the recording, its truth and its rig into a new folder, by the simulator's own command."""
    with steps.step(HALF, "simulate") as report:
        command = [sys.executable, "-m", "workers.simulation", "--out", str(folder), "--seconds", str(SECONDS)]
        with subprocess.Popen([*command, "--progress-json"], stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            for line in process.stdout:
                said = json.loads(line)
                if said.get("stage") == "recording":
                    report(said["done"] / said["total"], f"{SECONDS} s of VLP-16 and camera")
        if process.returncode != 0:
            raise ClientError("the simulator failed", "What it said stands above.")
        size = (folder / "recording.bag").stat().st_size
        report(1.0, f"a ROS 1 bag of {size / 1e6:.0f} MB")


def run(steps: Steps, client: Client, fleet: FleetOut, folder: Path) -> Document:
    """From the bag to results: the ``simulated`` part of the report."""
    truth = Truth(folder / "truth.json")
    vehicle = client.vehicles.create(fleet.id, "Simulated vehicle")
    rig = client.vehicles.create_rig(vehicle.id, read_rig(folder / "rig.json", "Front camera"))
    recording = job.upload(steps, HALF, client, folder / "recording.bag", rig, "Walk with a board", marks=len(NAMES))
    region = read_region(folder / "region.json")
    kept = job.preview(steps, HALF, client, recording, region)
    strict = job.detect(steps, HALF, client, recording, region, "strict")
    tolerant = job.detect(steps, HALF, client, recording, region, "tolerant")
    refined = job.detect(steps, HALF, client, recording, region, "refined", mode="interpolate")
    with steps.step(HALF, "three people mark") as report:
        progress, tally = mark_everything(client, fleet.id, tolerant, CAMERA, truth, report)
        report(1.0, f"{tally.marks} marks on {progress.complete} vertices, {tally.rejected} rejections")
    pairs = client.correspondence_sets.build(tolerant.id, CAMERA)
    calibration, results = job.calibrate(steps, HALF, client, pairs, folds=FOLDS, farm="slots", publish="recommended")
    document: Document = dict(judge(client, truth, pairs, calibration, results))
    document["refined"] = _with_refined(steps, client, truth, refined)
    document |= {
        "model": truth.model,
        "detections": job.acceptance([strict, tolerant, refined]),
        "region": kept.model_dump(include={"frames", "frames_kept", "points", "points_kept"}),
        "marks": tally.marks,
        "notes": calibration.notes,
        "recording_id": str(recording.id),
        "detection_id": str(tolerant.id),
        "calibration_id": str(calibration.id),
    }
    found = job.summary_of(calibration, CAMERA)
    # A result that does not pass its checks does not publish itself.
    published = str(client.calibrations.current(vehicle.id, CAMERA).result_id) if found.published else None
    return document | {
        "current": published,
        "checks": [one.model_dump() for one in found.checks if one.verdict != "pass"],
    }


def _with_refined(steps: Steps, client: Client, truth: Truth, refined: DetectionView) -> Document:
    """The true model once more, from refined vertices that were moved to their frames' times, with the same marks."""
    pairs = client.correspondence_sets.build(refined.id, CAMERA)
    calibration, results = job.calibrate(
        steps, HALF, client, pairs, models=[truth.model], title="calibrate (refined)", folds=FOLDS
    )
    figures = judge(client, truth, pairs, calibration, results)
    return figures[truth.model] | {"pairs": pairs.count}


def judge(
    client: Client, truth: Truth, pairs: SetView, calibration: CalibrationView, results: dict[str, ResultView]
) -> Document:
    """Each model's figures with its errors against the truth, and what the truth itself would score.

    Every pair is held out once, so the true parameters' held-out error is their mean error on all pairs.
    """
    heldout_truth_px = float(np.mean(truth.errors_px(client.correspondence_sets.get(pairs.id).pairs)))
    models = job.figures(calibration, CAMERA)
    summary = job.summary_of(calibration, CAMERA).models
    workers = {worker for found in summary.values() for worker in found.workers}
    for name, figures in models.items():
        rotation_deg, translation_m = truth.errors_of(results[name].transform)
        figures |= {
            "heldout_truth_px": heldout_truth_px,
            "rotation_error_deg": rotation_deg,
            "translation_error_m": translation_m,
            "workers_used": len(set(summary[name].workers)),
        }
    return {**models, "pairs": pairs.count, "workers_used": len(workers)}
