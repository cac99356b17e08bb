"""Rig files as people and the simulator write them."""

import json

import pytest

from apexcal.errors import ClientError
from apexcal.rigs import read_rig

RIG = {"lidar": {"frame": "velodyne"}, "cameras": []}


@pytest.mark.parametrize(
    ("own", "given", "name"), [({"name": "roof"}, "", "roof"), ({"name": "roof"}, "top", "top"), ({}, "", "truck")]
)
def test_the_name_is_the_one_given_or_the_files_or_the_folders(tmp_path, own, given, name):
    folder = tmp_path / "truck"
    folder.mkdir()
    (folder / "rig.json").write_text(json.dumps(RIG | own))
    assert read_rig(folder / "rig.json", given) == RIG | {"name": name}


@pytest.mark.parametrize("text", ["{", "[]", "{}", '{"lidar": {"frame": "a"}}'])
def test_a_file_that_is_no_rig_is_said(tmp_path, text):
    path = tmp_path / "rig.json"
    path.write_text(text)
    with pytest.raises(ClientError, match=r"rig\.json"):
        read_rig(path)


@pytest.mark.parametrize("depth", [101, 900, 990, 100_000])
def test_a_file_that_is_nested_too_deeply_is_said(tmp_path, depth):
    path = tmp_path / "rig.json"
    path.write_text('{"lidar": ' + "[" * depth + "]" * depth + ', "cameras": []}')
    with pytest.raises(ClientError, match=r"rig\.json is nested too deeply"):
        read_rig(path)


def test_a_rig_holds_finite_numbers(tmp_path):
    path = tmp_path / "rig.json"
    path.write_text('{"lidar": {}, "cameras": [NaN]}')
    with pytest.raises(ClientError, match=r"rig\.json holds NaN"):
        read_rig(path)
