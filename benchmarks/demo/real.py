"""Second half: real VLP-16 sweeps and images (acfr/cam_lidar_calibration), 80 published correspondences."""

from __future__ import annotations

from pathlib import Path

from apexcal.commands.calibrate import calibrate
from apexcal.commands.detect import detect, suggest
from apexcal.commands.recordings import upload
from apexcal.documents.detectors import DetectorName
from apexcal.documents.fleets import FleetOut
from apexcal.transport import Document
from benchmarks.demo import report
from benchmarks.demo.steps import DemoSession

DETECTORS: tuple[DetectorName, ...] = ("strict", "tolerant", "refined")
CAMERA = "front"
# As its authors give it.
BOARD = "0.61x0.85"
# An upright camera that looks along the LiDAR's x axis; where exactly, the calibration finds.
RIG: Document = {
    "name": "Wide-angle camera",
    "lidar": {"frame": "velodyne", "topic": "/velodyne_points"},
    "cameras": [
        {
            "name": CAMERA,
            "frame": "camera",
            "topic": "/camera/image_color/compressed",
            "image_size": [1920, 1208],
            "nominal": {
                "to_frame": "camera",
                "from_frame": "velodyne",
                "rotation": {"matrix": [[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]},
                "translation_m": [0.0, 0.0, 0.0],
            },
        }
    ],
}


def find_data(start: Path) -> Path | None:
    """The folder of the real recording, beside the repository; None where it is absent."""
    folder = start.resolve().parent / "shared" / "data" / "vlp16-diamond-board"
    return folder if (folder / "recording.bag").is_file() and (folder / "correspondences.csv").is_file() else None


def run(session: DemoSession, fleet: FleetOut, folder: Path, scratch: Path) -> Document:
    """Ingest, detect, and calibrate from the imported correspondences: the ``real`` part of the report."""
    vehicles = session.client.vehicles
    vehicle = vehicles.create(fleet.id, "Real vehicle")
    vehicles.create_rig(vehicle.id, RIG)
    bag, on, name = folder / "recording.bag", str(vehicle.id), "Diamond board, 20 poses"
    # Still poses whose stamps were made up: when in its turn the LiDAR saw a point means nothing here.
    recording = session.run("upload and ingest", upload, bag, vehicle=on, name=name, still=True)
    region = scratch / "region.json"
    session.run("region of interest", suggest, str(recording.id), out=region)
    detections = [
        session.run(
            f"detect ({detector})",
            detect,
            str(recording.id),
            region=region,
            detector=detector,
            board=BOARD if detector == "refined" else "",
        )
        for detector in DETECTORS
    ]
    pairs = [str(folder / "correspondences.csv")]
    calibration = session.run("calibrate", calibrate, pairs=pairs, vehicle=on, folds=5, publish=True)
    figures = report.figures(calibration, CAMERA)
    return {
        **figures,
        "correspondences": figures["pinhole"]["pairs"],
        "detections": report.acceptance(detections),
        "notes": calibration.notes,
        "recording_id": str(recording.id),
        "calibration_id": str(calibration.id),
    }
