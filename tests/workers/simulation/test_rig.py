"""Several cameras, their clock, and the truth that goes with them; nothing is painted."""

import json

import numpy as np
import pytest

from apexcal.documents.simulation import SimulationOptions, parse_cameras
from apexcal.geometry.se3 import from_document
from workers.simulation.rig import SimulatedRig
from workers.simulation.truth import rig_document, truth_document


def rig_of(**options):
    return SimulatedRig(SimulationOptions(seconds=20.0, seed=4, **options))


def test_how_many_cameras_are_spread_over_the_view():
    three = parse_cameras("3")
    assert [camera.yaw_deg for camera in three] == [50.0, 0.0, -50.0]
    assert len({camera.name for camera in parse_cameras("11")}) == 11
    assert [camera.name for camera in parse_cameras("1")] == ["front"]


def test_each_camera_has_its_own_mount_lens_and_clock_ticks():
    rig = rig_of(cameras="front,left,right:-45:pinhole")
    names = {"lidar": "/points", "front": "/f", "left": "/l", "right": "/r"}
    truth, description = json.loads(json.dumps([truth_document(rig), rig_document(rig, names)]))
    assert list(truth["cameras"]) == ["front", "left", "right"]
    assert [truth["cameras"][name]["intrinsics"]["model"] for name in truth["cameras"]] == [
        "brown_conrady", "brown_conrady", "pinhole",
    ]  # fmt: skip
    assert {key: truth[key] for key in ("transform", "intrinsics", "frames")} == truth["cameras"]["front"]
    looks = {}
    for camera in description["cameras"]:
        nominal = from_document(camera["nominal"])
        real = from_document(truth["cameras"][camera["name"]]["transform"])
        assert nominal.to_frame == real.to_frame == camera["frame"] == f"camera_{camera['name']}_optical"
        off_rad = np.arccos(np.clip((np.trace(nominal.R @ real.R.T) - 1) / 2, -1, 1))
        assert 0.05 < np.degrees(off_rad) < 8.0
        looks[camera["name"]] = np.degrees(np.arctan2(nominal.R[2, 1], nominal.R[2, 0]))
    assert looks == pytest.approx({"front": 0.0, "left": 45.0, "right": -45.0}, abs=1e-9)
    stamps = [truth["cameras"][name]["frames"]["stamp_ns"] for name in truth["cameras"]]
    assert len({tuple(one) for one in stamps}) == 3
    left, front = (truth["cameras"][name]["intrinsics"] for name in ("left", "front"))
    assert 0.1 < abs(left["f_x"] - front["f_x"]) < 20.0


def test_the_cameras_clock_runs_ahead_by_what_was_asked_and_the_truth_says_so():
    plain, shifted = rig_of(), rig_of(clock_offset_ms=30.0)
    np.testing.assert_array_equal(shifted.frame_stamps_ns - plain.frame_stamps_ns, 30_000_000)
    np.testing.assert_array_equal(shifted.cameras[0].times_ns, plain.cameras[0].times_ns)
    truth, unshifted = truth_document(shifted), truth_document(plain)
    assert truth["clock"] == {"offset_ns": 30_000_000, "jitter_ns": 0}
    # What a frame shows is where the board was when it was taken, whatever its stamp.
    assert truth["frames"]["apex_uv"] == unshifted["frames"]["apex_uv"]
    assert truth["sweeps"] == unshifted["sweeps"]


def test_stamps_that_jitter_never_go_back():
    rig = rig_of(clock_jitter_ms=20.0, camera_hz=100.0)
    off_ns = rig.frame_stamps_ns - rig.cameras[0].times_ns
    assert (np.diff(rig.frame_stamps_ns) > 0).all()
    assert 10e6 < off_ns.std() < 25e6


def test_the_first_camera_does_not_change_when_others_are_added():
    alone, among = rig_of(), rig_of(cameras="front,left")
    assert among.camera.intrinsics == alone.camera.intrinsics
    np.testing.assert_array_equal(among.camera.T_camera_lidar.R, alone.camera.T_camera_lidar.R)
    np.testing.assert_array_equal(among.frame_stamps_ns, alone.frame_stamps_ns)
    np.testing.assert_array_equal(among.sweep(3).xyz, alone.sweep(3).xyz)
