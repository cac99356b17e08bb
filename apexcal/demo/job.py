"""The steps that both halves of the demo share: a recording goes up, vertices are found, calibrations come back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from apexcal.client import Client
from apexcal.demo.steps import Steps
from apexcal.documents.camera_models import MODELS
from apexcal.transport import Document


def upload(
    steps: Steps,
    half: str,
    client: Client,
    path: Path,
    rig: Document,
    name: str,
    *,
    marks: int = 1,
    reading: Mapping[str, Any] | None = None,
) -> Document:
    """Upload a recording and wait until it is ingested."""
    with steps.step(half, "upload") as report:
        recording = client.recordings.upload(
            path,
            rig["vehicle_id"],
            rig["id"],
            name=name,
            marks_per_vertex=marks,
            reading=reading,
            on_progress=lambda done, total: report(done / total, f"{done / 1e6:.0f} of {total / 1e6:.0f} MB"),
        )
    with steps.step(half, "ingest") as report:
        recording = client.wait(recording, on_progress=report)
        report(1.0, ", ".join(f"{each['name']}: {each['count']}" for each in recording["sensors"]))
    return recording


def preview(steps: Steps, half: str, client: Client, recording: Document, region: Mapping[str, Any]) -> Document:
    """What the region of interest keeps."""
    with steps.step(half, "region of interest") as report:
        result: Document = client.wait(client.detections.preview(recording["id"], region), on_progress=report)[
            "result"
        ]
        report(1.0, f"keeps {result['points_kept']} of {result['points']} points")
    return result


def detect(
    steps: Steps,
    half: str,
    client: Client,
    recording: Document,
    region: Mapping[str, Any],
    detector: str,
    **request: Any,
) -> Document:
    """One detection run; its counts are shown."""
    with steps.step(half, f"detect ({detector})") as report:
        started = client.detections.create(recording["id"], region, detector=detector, **request)
        detection = client.wait(started, on_progress=report)
        counts = detection["counts"]
        report(1.0, f"{counts['accepted']} of {counts['sweeps']} sweeps accepted")
    return detection


def calibrate(
    steps: Steps,
    half: str,
    client: Client,
    pairs: Document,
    *,
    models: Sequence[str] = MODELS,
    title: str = "calibrate",
    **request: Any,
) -> tuple[Document, dict[str, Document]]:
    """Calibrate with every model, or with some; the calibration and each model's whole result."""
    with steps.step(half, title) as report:
        started = client.calibrations.create(pairs["vehicle_id"], [pairs["id"]], models, **request)
        calibration = client.wait(started, on_progress=report)
        summary = calibration["summary"]["cameras"][pairs["camera"]]
        report(1.0, f"recommended: {summary['recommended']}")
    results = {model: client.calibrations.result(found["result_id"]) for model, found in summary["models"].items()}
    return calibration, results


def figures(calibration: Document, camera: str) -> dict[str, Document]:
    """For each model the figures that the demo reports; pixels and seconds."""
    models = calibration["summary"]["cameras"][camera]["models"]
    return {
        model: {
            "ga_px": found["ga"]["mean_px"],
            "ga_rms_px": found["ga"]["rms_px"],
            "polished_px": found["polished"]["mean_px"],
            "polished_rms_px": found["polished"]["rms_px"],
            "baseline_px": found["baseline"]["mean_px"],
            "baseline_rms_px": found["baseline"]["rms_px"],
            "heldout_px": found["heldout_mean_px"],
            "heldout_rms_px": found["heldout_rms_px"],
            "seconds": found["seconds"],
            "iterations": found["iterations"],
            "pairs": found["pairs"],
        }
        for model, found in ((name, models[name]) for name in MODELS if name in models)
    }


def acceptance(detections: Sequence[Document]) -> dict[str, Document]:
    """For each detector how many sweeps it accepted."""
    return {
        each["detector"]: {"accepted": each["counts"]["accepted"], "sweeps": each["counts"]["sweeps"]}
        for each in detections
    }
