"""Steps of both halves of the demo: upload, detect, calibrate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from apexcal.client import Client
from apexcal.demo.steps import Steps
from apexcal.documents.calibrations import CalibrationView
from apexcal.documents.camera_models import MODELS
from apexcal.documents.correspondence_sets import SetView
from apexcal.documents.detections import DetectionView
from apexcal.documents.fleets import RigOut
from apexcal.documents.recordings import RecordingView
from apexcal.documents.results import ResultView
from apexcal.documents.studies import RegionPreview
from apexcal.documents.summaries import CameraSummary
from apexcal.transport import Document


def upload(
    steps: Steps,
    half: str,
    client: Client,
    path: Path,
    rig: RigOut,
    name: str,
    *,
    marks: int = 1,
    reading: Mapping[str, Any] | None = None,
) -> RecordingView:
    """Upload a recording and wait until it is ingested."""
    with steps.step(half, "upload") as report:
        uploaded = client.recordings.upload(
            path,
            rig.vehicle_id,
            rig.id,
            name=name,
            marks_per_vertex=marks,
            reading=reading,
            on_progress=lambda done, total: report(done / total, f"{done / 1e6:.0f} of {total / 1e6:.0f} MB"),
        )
    with steps.step(half, "ingest") as report:
        recording = client.wait(uploaded, on_progress=report)
        report(1.0, ", ".join(f"{each.name}: {each.count}" for each in recording.sensors))
    return recording


def preview(
    steps: Steps, half: str, client: Client, recording: RecordingView, region: Mapping[str, Any]
) -> RegionPreview:
    """What the region of interest keeps."""
    with steps.step(half, "region of interest") as report:
        result = client.wait(client.detections.preview(recording.id, region), on_progress=report).result
        assert result is not None
        report(1.0, f"keeps {result.points_kept} of {result.points} points")
    return result


def suggest(steps: Steps, half: str, client: Client, recording: RecordingView) -> Mapping[str, Any]:
    """The region that the service suggests."""
    with steps.step(half, "region of interest") as report:
        result = client.wait(client.detections.suggest(recording.id), on_progress=report).result
        assert result is not None
        report(1.0, f"{result.facts.poses} still poses within {result.facts.area_m2:.0f} square metres")
    return result.region


def detect(
    steps: Steps,
    half: str,
    client: Client,
    recording: RecordingView,
    region: Mapping[str, Any],
    detector: str,
    **request: Any,
) -> DetectionView:
    """One detection run; its counts are shown."""
    with steps.step(half, f"detect ({detector})") as report:
        started = client.detections.create(recording.id, region, detector=detector, **request)
        detection = client.wait(started, on_progress=report)
        counts = detection.counts
        report(1.0, f"{counts.accepted} of {counts.sweeps} sweeps accepted")
    return detection


def calibrate(
    steps: Steps,
    half: str,
    client: Client,
    pairs: SetView,
    *,
    models: Sequence[str] = MODELS,
    title: str = "calibrate",
    **request: Any,
) -> tuple[CalibrationView, dict[str, ResultView]]:
    """Calibrate with every model, or with some; the calibration and each model's whole result."""
    with steps.step(half, title) as report:
        started = client.calibrations.create(pairs.vehicle_id, [pairs.id], models, **request)
        calibration = client.wait(started, on_progress=report)
        summary = summary_of(calibration, pairs.camera)
        report(1.0, f"recommended: {summary.recommended}")
    results = {model: client.calibrations.result(found.result_id) for model, found in summary.models.items()}
    return calibration, results


def summary_of(calibration: CalibrationView, camera: str) -> CameraSummary:
    """What a finished calibration found for a camera."""
    assert calibration.summary is not None
    return calibration.summary.cameras[camera]


def figures(calibration: CalibrationView, camera: str) -> dict[str, Document]:
    """For each model the figures that the demo reports; pixels and seconds."""
    models = summary_of(calibration, camera).models
    return {
        model: {
            **{f"{stage}_px": errors.mean_px for stage, errors in found.stages.items()},
            **{f"{stage}_rms_px": errors.rms_px for stage, errors in found.stages.items()},
            "heldout_px": found.heldout_mean_px,
            "heldout_rms_px": found.heldout_rms_px,
            "seconds": found.seconds,
            "iterations": found.iterations,
            "pairs": found.pairs,
        }
        for model, found in ((name, models[name]) for name in MODELS if name in models)
    }


def acceptance(detections: Sequence[DetectionView]) -> dict[str, Document]:
    """For each detector how many sweeps it accepted."""
    return {each.detector: {"accepted": each.counts.accepted, "sweeps": each.counts.sweeps} for each in detections}
