"""`apexcal export` in other programs' formats: one file, several below a folder, a ZIP, and a patched URDF."""

from __future__ import annotations

import zipfile

import yaml
from typer.testing import CliRunner

from apexcal.cli import app
from tests.apexcal.cars import Car
from tests.service.exports.test_routes import URDF
from tests.support.databases import one_database

pytestmark = one_database


def export(car: Car, *more: str):
    return CliRunner().invoke(app, ["export", "--token", car.viewer.token, "--url", car.url, *more])


def test_one_file_or_several(car, tmp_path):
    said = export(car, "--format", "camera_info")
    assert said.exit_code == 0 and yaml.safe_load(said.stdout)["camera_name"] == "front"
    chain = tmp_path / "camchain.yaml"
    assert export(car, "--format", "kalibr", "-o", str(chain)).exit_code == 0
    assert yaml.safe_load(chain.read_text())["cam0"]["resolution"] == [640, 480]
    assert export(car, "--format", "kalibr", "-o", str(chain)).exit_code == 2, "it is there already"
    assert export(car, "--format", "kitti").exit_code == 2, "several files have no place on a terminal"
    folder = tmp_path / "kitti"
    assert export(car, "--format", "kitti", "-o", str(folder)).exit_code == 0
    files = {str(one.relative_to(folder)): one.read_bytes() for one in folder.rglob("*.txt")}
    assert sorted(files) == [f"front/calib_{name}.txt" for name in ("cam_to_cam", "imu_to_velo", "velo_to_cam")]
    assert export(car, "--format", "kitti", "-o", str(folder)).exit_code == 2
    assert export(car, "--format", "kitti", "-o", str(folder), "--force").exit_code == 0
    packed = tmp_path / "kitti.zip"
    assert export(car, "--format", "kitti", "-o", str(packed)).exit_code == 0
    with zipfile.ZipFile(packed) as archive:
        assert {one: archive.read(one) for one in archive.namelist()} == files
    unknown = export(car, "--format", "xyz")
    assert unknown.exit_code == 2 and "openlabel" in unknown.stderr


def test_of_one_result(car):
    (one,) = car.viewer.get(f"/vehicles/{car.rig.vehicle_id}/cameras/front/publications").json()["items"]
    of_result = export(car, "--format", "opencv", "--result", one["result_id"])
    assert of_result.exit_code == 0 and of_result.stdout == export(car, "--format", "opencv").stdout


def test_a_urdf_with_its_one_joint(car, tmp_path):
    mine, new = tmp_path / "car.urdf", tmp_path / "new.urdf"
    mine.write_bytes(URDF.replace("\n", "\r\n").encode())
    assert export(car, "--urdf", str(mine), "--joint", "mount", "-o", str(new)).exit_code == 0
    head, tail = mine.read_bytes().split(b'<origin xyz="1 1 1"/>')
    assert new.read_bytes().startswith(head) and new.read_bytes().endswith(tail)
    refused = export(car, "--urdf", str(mine), "--joint", "wheel")
    assert refused.exit_code == 1 and "mount" in refused.stderr
    assert export(car, "--urdf", str(mine)).exit_code == 2
