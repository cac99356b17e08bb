"""Second half: real VLP-16 sweeps and images (acfr/cam_lidar_calibration), 80 published correspondences."""

from __future__ import annotations

from pathlib import Path

from apexcal.client import Client
from apexcal.demo import job
from apexcal.demo.steps import Steps
from apexcal.documents.fleets import FleetOut
from apexcal.transport import Document

HALF = "real"
CAMERA = "front"
# As its authors give it.
BOARD: Document = {"board_width_m": 0.61, "board_height_m": 0.85}
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


def run(steps: Steps, client: Client, fleet: FleetOut, folder: Path) -> Document:
    """Ingest, detect, and calibrate from the imported correspondences: the ``real`` part of the report."""
    vehicle = client.vehicles.create(fleet.id, "Real vehicle")
    rig = client.vehicles.create_rig(vehicle.id, RIG)
    # Still poses whose stamps were made up: when in its turn the LiDAR saw a point means nothing here.
    reading = {"point_times": "stamp_only"}
    bag = folder / "recording.bag"
    recording = job.upload(steps, HALF, client, bag, rig, "Diamond board, 20 poses", reading=reading)
    region = job.suggest(steps, HALF, client, recording)
    strict = job.detect(steps, HALF, client, recording, region, "strict")
    tolerant = job.detect(steps, HALF, client, recording, region, "tolerant")
    refined = job.detect(steps, HALF, client, recording, region, "refined", options=BOARD)
    with steps.step(HALF, "import correspondences") as report:
        text = (folder / "correspondences.csv").read_bytes()
        pairs = client.correspondence_sets.import_csv(rig.id, CAMERA, text)
        report(1.0, f"{pairs.count} pairs")
    calibration, _ = job.calibrate(steps, HALF, client, pairs, folds=5, publish="recommended")
    document: Document = dict(job.figures(calibration, CAMERA))
    document |= {
        "correspondences": pairs.count,
        "detections": job.acceptance([strict, tolerant, refined]),
        "notes": calibration.notes,
        "recording_id": str(recording.id),
        "calibration_id": str(calibration.id),
    }
    return document
