"""nuScenes' tables: our own export read back, several logs, and the records of a folder's files."""

import json

import numpy as np
import pytest

from apexcal.documents.imports import CalibrationFiles
from apexcal.geometry.se3 import from_document
from service.imports.__main__ import main
from service.imports.formats import files_view
from service.imports.nuscenes import of_recording
from service.platform.http.problems import Problem
from tests.service.exports.readers import files_of
from tests.service.exports.rigs import rig_of


@pytest.fixture
def rig():
    return rig_of("pinhole", 0)


@pytest.fixture
def tables(rig):
    return {name: content.decode() for name, content in files_of("nuscenes", rig).items() if name.endswith(".json")}


def read(texts, **more):
    return files_view(CalibrationFiles(files=texts), **more).cameras


def moved(tables):
    """The tables with a second log in which the sensors stand elsewhere; and the records of the first."""
    records = json.loads(tables["calibrated_sensor.json"])
    others = [
        record | {"token": f"other-{number}", "translation": [2.0, 0.1 * number, 1.0]}
        for number, record in enumerate(records)
    ]
    return tables | {"calibrated_sensor.json": json.dumps([*others, *records])}, records


def test_our_export_is_read_back(rig, tables):
    cameras = read(tables, needs_size=False)
    assert [camera.name for camera in cameras] == [f"CAM_{camera.name.upper()}" for camera in rig.cameras]
    for camera, ours in zip(cameras, rig.cameras, strict=True):
        mount = from_document(camera.T_camera_lidar.model_dump(mode="json"))
        np.testing.assert_allclose(mount.matrix, ours.T_camera_lidar.matrix, atol=1e-6)
        np.testing.assert_allclose(camera.lens.K, np.ravel(ours.K))
        assert (camera.lens.width, camera.lens.height) == (0, 0)
    sized = files_view(CalibrationFiles(files=tables, image_size=(640, 480))).cameras[0].lens
    assert (sized.width, sized.height) == (640, 480)
    with pytest.raises(Problem, match="image size"):
        read(tables)


def test_of_several_logs_the_folders_files_tell_the_poses(rig, tables, tmp_path, capsys):
    both, records = moved(tables)
    with pytest.raises(Problem, match="several poses") as refused:
        read(both, needs_size=False)
    assert "sample_data.json" in refused.value.hint
    rows = [
        {"filename": f"samples/S{number}/a__{number}.bin", "calibrated_sensor_token": record["token"]}
        | ({"width": 1600, "height": 900} if record["camera_intrinsic"] else {"width": 0, "height": 0})
        for number, record in enumerate(records)
    ]
    rows.append({"filename": "samples/S0/b__0.bin", "calibrated_sensor_token": "other-0"})
    both["sample_data.json"] = json.dumps(rows)
    with pytest.raises(Problem, match="names no file of"):
        of_recording(both, tmp_path)
    for number in range(len(records)):
        (tmp_path / f"a__{number}.bin").write_bytes(b"")
    paths = [tmp_path / name for name in both]
    for path in paths:
        path.write_text(both[path.name])
    assert main(str(tmp_path), *map(str, paths)) == 0
    cameras = json.loads(capsys.readouterr().out)["read"]["cameras"]
    whole = read(tables, needs_size=False)
    assert [camera["T_camera_lidar"] for camera in cameras] == [
        camera.T_camera_lidar.model_dump(mode="json") for camera in whole
    ]
    assert {(camera["lens"]["width"], camera["lens"]["height"]) for camera in cameras} == {(1600, 900)}
