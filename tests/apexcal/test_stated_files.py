"""`--intrinsics` and `apexcal compare`: files of other programs at the command line."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

from apexcal.cli import app
from apexcal.client import ApiError, Client
from apexcal.commands.stated_files import read_lens
from apexcal.errors import InputError
from tests.apexcal.cars import Car
from tests.service.imports.test_read_files import CAMCHAIN, CAMERA_CALIBRATION, K
from tests.support.databases import one_database

pytestmark = one_database

CHAIN = CAMCHAIN.replace("omni", "pinhole").replace("[1.0, 500.0, 510.0", "[500.0, 510.0")
CHAIN = CHAIN.replace("  T_cn_cnm1", "  distortion_model: none\n  resolution: [640, 480]\n  T_cn_cnm1")


@pytest.fixture
def client(car):
    with Client(car.url, car.viewer.token) as opened:
        yield opened


def run(car: Car, *words: str):
    return CliRunner().invoke(app, [*words, "--token", car.viewer.token, "--url", car.url])


def test_a_lens_by_camera_topic_or_name(client, tmp_path):
    plain, chain = tmp_path / "lens.yaml", tmp_path / "camchain.yaml"
    plain.write_text(CAMERA_CALIBRATION)
    chain.write_text(CHAIN)
    only = read_lens(client, str(plain), "anything")
    assert (only["K"], only["distortion_model"]) == (K, "plumb_bob")
    assert read_lens(client, str(chain), "front")["distortion_model"] == "equidistant"
    assert read_lens(client, f"{chain}#cam1", "front")["distortion_model"] == "none"
    with pytest.raises(InputError, match="cam0, cam1, and none of them is clearly left"):
        read_lens(client, str(chain), "left")
    with pytest.raises(ApiError) as refused:
        plain.write_text("a: [")
        read_lens(client, str(plain), "front")
    assert refused.value.code == "calibration_file_not_read"
    with pytest.raises(InputError, match="no such file"):
        read_lens(client, str(tmp_path / "none.yaml"), "front")


def test_compare_with_a_file(car, tmp_path):
    file = tmp_path / "front.yaml"
    assert run(car, "export", "--format", "opencv", "-o", str(file)).exit_code == 0
    (one,) = car.viewer.get(f"/vehicles/{car.rig.vehicle_id}/cameras/front/publications").json()["items"]
    asked = ["compare", str(file), "--result", one["result_id"]]
    same = run(car, *asked)
    assert same.exit_code == 0, same.stderr
    assert "differs by 0.000 degrees and 0.0 mm" in same.stdout and "f_x +0.00" in same.stdout
    lidar, camera = 'lidar_frame: "velodyne"', 'camera_frame: "camera_front_optical"'
    assert lidar in file.read_text() and camera in file.read_text()
    said = json.loads(run(car, *asked, "--json").stdout)
    assert said["read_as"] == "stated" and said["T_camera_lidar"]["from_frame"] == "velodyne"
    file.write_text("nothing")
    refused = run(car, *asked)
    assert refused.exit_code == 1 and "no named values" in refused.stderr


def test_compare_with_another_result(car, tmp_path):
    (one,) = car.viewer.get(f"/vehicles/{car.rig.vehicle_id}/cameras/front/publications").json()["items"]
    asked = ["compare", "--result", one["result_id"]]
    same = run(car, *asked, "--with", one["result_id"])
    assert same.exit_code == 0, same.stderr
    assert "differ by 0.000 degrees and 0.0 mm" in same.stdout and "same pairs" in same.stdout
    assert json.loads(run(car, *asked, "--with", one["result_id"], "--json").stdout)["shares_pairs"]
    file = tmp_path / "front.yaml"
    file.write_text("nothing")
    for wrong in ([], [str(file), "--with", one["result_id"]]):
        assert run(car, *asked, *wrong).exit_code == 2
