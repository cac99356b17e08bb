"""Every format after the default path: a recording goes up, people mark, and each export is read by its own reader.

The way is the one that a stranger takes: detection, marks, the pairs of these marks, a calibration of all models.
"""

from __future__ import annotations

import io
import json
import re
import subprocess
import sys
import zipfile
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from apexcal.client import ApiError, Client
from apexcal.demo.annotators import mark_everything
from apexcal.demo.truth import Truth, project
from apexcal.geometry.se3 import from_document
from apexcal.rigs import read_rig
from service.exports.calibrated import Calibrated, CalibratedCamera
from service.exports.formats import FORMATS
from tests.service.exports import readers

ON_VEHICLE = {
    "to_frame": "base_link",
    "from_frame": "velodyne",
    "rotation": {"quaternion_xyzw": [0.0, 0.0, 0.38268343236509, 0.92387953251129]},
    "translation_m": [1.2, 0.0, 1.9],
}


pytestmark = pytest.mark.timeout(900)


@pytest.fixture(scope="module")
def results(embedded, tmp_path_factory):
    """The client, the vehicle, and the result of each model."""
    folder = tmp_path_factory.mktemp("exports") / "walk"
    command = [sys.executable, "-m", "workers.simulation", "--out", str(folder), "--seconds", "10"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    with Client(embedded.url, embedded.token) as owner:
        fleet = owner.fleets.create("Exports")
        vehicle = owner.vehicles.create(fleet.id, "Wagon")
        described = read_rig(folder / "rig.json", "Roof")
        described["T_vehicle_lidar"] = ON_VEHICLE | {"from_frame": described["lidar"]["frame"]}
        rig = owner.vehicles.create_rig(vehicle.id, described)
        recording = owner.wait(owner.recordings.upload(folder / "recording.bag", vehicle.id, rig.id), timeout_s=120)
        region = owner.wait(owner.analyses.suggest(recording.id), timeout_s=120).result.region
        detection = owner.wait(owner.detections.create(recording.id, region), timeout_s=200)
        mark_everything(owner, fleet.id, detection, "front", Truth(folder / "truth.json"), lambda *said: None)
        pairs = owner.correspondence_sets.build(detection.id, "front")
        calibration = owner.wait(owner.calibrations.create(vehicle.id, [pairs.id], folds=0), timeout_s=800)
        models = calibration.summary.cameras["front"].models
        points = owner.correspondence_sets.get(pairs.id).pairs
        assert len(points) > 20
        xyz = np.array([[pair.x, pair.y, pair.z] for pair in points])
        yield owner, vehicle.id, rig, {model: one.result_id for model, one in models.items()}, xyz


def as_calibrated(result, rig) -> Calibrated:
    """What our own document says, for the readers."""
    document = json.loads(result.model_dump_json())
    (camera,) = rig.cameras
    return Calibrated(
        "Wagon",
        [
            CalibratedCamera(
                name=camera.name,
                topic=camera.topic,
                width=camera.image_size[0],
                height=camera.image_size[1],
                model=document["model"],
                intrinsics={k: v for k, v in document["intrinsics"].items() if v is not None and k != "model"},
                T_camera_lidar=from_document(document["transform"]),
                T_vehicle_lidar=from_document(ON_VEHICLE | {"from_frame": rig.lidar.frame}),
                rig=rig.name,
                source=str(result.id),
                at=datetime.now(UTC),
                marked=np.zeros((0, 2)),
            )
        ],
    )


def unpacked(made) -> dict[str, bytes]:
    if not made.name.endswith(".zip"):
        return {made.name: made.content}
    with zipfile.ZipFile(io.BytesIO(made.content)) as archive:
        return {one: archive.read(one) for one in archive.namelist()}


def test_each_format_of_each_result_means_the_same(results, monkeypatch):
    """To 1e-4 px, or to what the format says that it leaves out; a refusal says it too, or has no such lens."""
    owner, _, rig, by_model, xyz = results
    read: dict[str, set[str]] = {}
    for model, result_id in by_model.items():
        result = owner.calibrations.result(result_id)
        calibrated = as_calibrated(result, rig)
        (camera,) = calibrated.cameras
        T = camera.T_camera_lidar
        ours = project({"model": model, **camera.intrinsics}, xyz @ T.R.T + T.t)
        shown = ((ours >= 0) & (ours < [camera.width, camera.height])).all(axis=1)
        assert shown.sum() > 30
        files: dict[str, dict[str, bytes]] = {}
        monkeypatch.setattr(readers, "files_of", lambda name, _, files=files: files[name])
        notes: dict[str, str] = {}
        for name in FORMATS:
            try:
                made = owner.exports.result(result_id, name)
            except ApiError as refused:
                assert refused.code == "format_cannot_carry", (name, refused)
                stated = re.search(r"up to ([0-9.e+]+) px", refused.detail)
                assert float(stated[1]) > 1.0 if stated else "no lens model" in refused.detail, refused.detail
                continue
            files[name], notes[name] = unpacked(made), " ".join(made.notes)
        for name in files:
            if name == "urdf" and "camera_info" not in files:
                continue
            (projection,) = readers.READERS[name](calibrated)
            off = np.linalg.norm(projection(xyz[shown]) - ours[shown], axis=1).max()
            stated = re.search(r"up to ([0-9.e-]+) px", notes["camera_info" if name == "urdf" else name])
            assert off < (1.05 * float(stated[1]) if stated else 1e-4), (model, name, off, notes[name])
            read.setdefault(name, set()).add(model)
    assert read.keys() == FORMATS.keys(), "each format carries one of the default's results at least"


def test_the_recommended_one_is_published_and_pulled_in_every_format_that_carries_it(results, embedded, tmp_path):
    owner, vehicle_id, _, by_model, _ = results
    owner.calibrations.publish(by_model["brown_conrady"], "The way of a stranger.", override=True)
    for name in FORMATS:
        try:
            made = owner.exports.current(vehicle_id, "front", name)
        except ApiError as refused:
            assert refused.code == "format_cannot_carry" and name in ("nuscenes", "kalibr"), refused.detail
            continue
        assert made.content == owner.exports.result(by_model["brown_conrady"], name).content
        kept = owner.calibrations.vehicle_if_changed(vehicle_id, format=name)
        assert (
            kept is not None
            and kept[0]
            and owner.calibrations.vehicle_if_changed(vehicle_id, kept[1], format=name) is None
        )
    assert Path(embedded.data).is_dir()
