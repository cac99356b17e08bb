"""Options of the form CAMERA=FILE, and lenses that lie beside a recording."""

import json
from pathlib import Path

import pytest
import yaml

from apexcal.client import Client
from apexcal.commands.camera_files import camera_and_file
from apexcal.commands.stated_files import lens_files
from tests.apexcal.test_cli import apexcal
from tests.support.served import Embedded


def test_a_camera_before_its_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert [str(part) for part in camera_and_file("front=a.csv")] == ["front", "a.csv"]
    assert [str(part) for part in camera_and_file("a.csv")] == ["", "a.csv"]
    (tmp_path / "a=b.csv").touch()
    assert [str(part) for part in camera_and_file("a=b.csv")] == ["", "a=b.csv"]


def test_lenses_lie_in_the_folder_or_beside_the_file(tmp_path):
    images = tmp_path / "images"
    images.mkdir()
    for name in ("walk.bag", "camera_info.yaml", "notes.txt", "images/0.png", "images/intrinsics.json"):
        (tmp_path / name).touch()
    assert [file.name for file in lens_files(tmp_path)] == ["camera_info.yaml", "intrinsics.json"]
    assert [file.name for file in lens_files(tmp_path / "walk.bag")] == ["camera_info.yaml"]


@pytest.mark.timeout(300)
def test_a_lens_beside_a_bag_is_taken_and_said_and_one_that_is_given_goes_before(
    embedded: Embedded, owner: Client, simulated: Path, tmp_path: Path
):
    width, height = json.loads((simulated / "rig.json").read_text())["cameras"][0]["image_size"]
    lens = {
        "image_width": width,
        "image_height": height,
        "distortion_model": "plumb_bob",
        "camera_matrix": {"rows": 3, "cols": 3, "data": [700.0, 0, width / 2, 0, 700.0, height / 2, 0, 0, 1]},
        "distortion_coefficients": {"rows": 1, "cols": 5, "data": [0.1, 0, 0, 0, 0]},
    }
    (tmp_path / "recording.bag").symlink_to(simulated / "recording.bag")
    (tmp_path / "camera.json").write_text("{}")
    (tmp_path / "camera_info.yaml").write_text(yaml.safe_dump(lens))
    (tmp_path / "other.yaml").write_text(yaml.safe_dump(lens | {"image_width": width + 1}))
    where = ("--fleet", "Lenses", "--vehicle", "walk", "--data", embedded.data)
    apexcal("rig", simulated / "rig.json", *where)

    def uploaded(*words: str):
        ran = apexcal("upload", tmp_path / "recording.bag", *where, "--new", "--json", *words)
        return ran, json.loads(ran.stdout) if ran.returncode == 0 else {}

    ran, recording = uploaded()
    assert "The lens of front is that of" in ran.stderr and "No lens of front was taken from" in ran.stderr
    (camera,) = [each for each in owner.recordings.get(recording["id"]).sensors if each.kind == "camera"]
    assert camera.facts.camera_info.source == "camera_info.yaml" and camera.facts.camera_info.K[0] == 700.0
    refused, _ = uploaded("--intrinsics", str(tmp_path / "other.yaml"))
    assert refused.returncode == 1 and f"{width + 1} x {height}" in refused.stderr
    assert uploaded("--intrinsics", "rear=x.yaml")[0].returncode == 2
    assert len(list(owner.recordings.list(vehicle_id=recording["vehicle_id"]))) == 1, "nothing was uploaded for it"
