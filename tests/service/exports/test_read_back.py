"""Every export, read back by other programs' rules, puts every point where we put it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from service.exports.calibrated import Calibrated, file_name
from service.exports.format import WITHOUT_RATIONAL
from service.exports.formats import FORMATS, export
from service.platform.http.problems import Problem
from tests.service.exports.readers import READERS, files_of
from tests.service.exports.rigs import LENSES, ours, rig_of, seen, vehicle_mount

LIMIT_PX = 1e-4
CARRIED = [
    (name, model)
    for name in FORMATS
    for model in LENSES
    if not FORMATS[name].carries_lens or model in FORMATS[name].lenses
]


@pytest.mark.parametrize("rig", [0, 1])
@pytest.mark.parametrize(("name", "model"), CARRIED)
def test_points_fall_where_ours_do(name, model, rig):
    less = {} if FORMATS[name].third_radial or model != "brown_conrady" else {"k5": 0.0}
    calibrated = rig_of(model, rig, **less)
    projections = READERS[name](calibrated)
    assert len(projections) == 3
    for camera, projection in zip(calibrated.cameras, projections, strict=True):
        assert np.abs(projection(seen(camera)) - ours(camera)).max() < LIMIT_PX


@pytest.mark.parametrize("name", ["openlabel", "vcd"])
def test_a_skew_is_carried_where_the_matrix_is_used_whole(name):
    calibrated = rig_of("brown_conrady", 1, skew=0.013)
    for camera, projection in zip(calibrated.cameras, READERS[name](calibrated), strict=True):
        assert np.abs(projection(seen(camera)) - ours(camera)).max() < LIMIT_PX


def refusal(name, calibrated) -> Problem:
    with pytest.raises(Problem) as found:
        export(FORMATS[name], calibrated)
    assert (found.value.status, found.value.code) == (406, "format_cannot_carry")
    return found.value


LESS = [
    *((name, "brown_conrady", {"skew": 2e-4}) for name in ("camera_info", "ros2", "autoware", "kitti", "opencv")),
    *((name, "brown_conrady", {"skew": 2e-4}) for name in ("kitti_object", "nuscenes", "direct_visual")),
    *((name, "brown_conrady", {"k5": 1e-4, "skew": 2e-4}) for name in ("kalibr", "fast_livo2")),
]


@pytest.mark.parametrize(("name", "model", "changed"), LESS)
def test_what_a_format_leaves_out_is_said_in_pixels(name, model, changed):
    """As the format's own reader and our projection differ, at the pixels of the pairs."""
    calibrated = rig_of(model, 0, **changed)
    calibrated = replace(calibrated, cameras=[replace(one, marked=ours(one)) for one in calibrated.cameras])
    notes = [one for one in export(FORMATS[name], calibrated).notes if one.endswith("where pairs lie.")]
    assert len(notes) == 3
    for camera, projection, note in zip(calibrated.cameras, READERS[name](calibrated), notes, strict=True):
        off = np.linalg.norm(projection(seen(camera)) - ours(camera), axis=1)
        assert f"up to {off.max():.2g} px, in the median {np.median(off):.2g} px, where pairs lie" in note
        assert camera.name in note and off.max() > 0.02


@pytest.mark.parametrize("name", [name for name, one in FORMATS.items() if one.carries_lens and not one.skew])
def test_a_skew_of_more_than_a_mark_is_refused_where_readers_ignore_it(name):
    problem = refusal(name, rig_of("brown_conrady", 0, skew=1e-2, k5=0.0))
    assert "skew of 0.01" in problem.detail and "px" in problem.detail and "skew locked at 0" in problem.hint
    assert problem.fields["formats"] == ["json", "urdf", "openlabel", "vcd"]


def test_a_lens_that_readers_do_not_know_is_refused():
    problem = refusal("kitti", rig_of("kannala_brandt", 0))
    assert "kannala_brandt" in problem.detail
    assert problem.fields["formats"] == ["json", *(name for name in FORMATS if name != "kitti")]
    problem = refusal("kalibr", rig_of("brown_conrady", 0))
    assert "third radial" in problem.detail and "k5 locked at 0" in problem.hint


@pytest.mark.parametrize("name", ["kitti_object", "nuscenes"])
def test_a_format_of_undistorted_images_says_how_to_make_them(name):
    """OpenCV undistorts an image as the export says: its pixels are where the export's matrix puts them."""
    calibrated = rig_of("kannala_brandt", 0)
    exported = export(FORMATS[name], calibrated)
    for camera in calibrated.cameras:
        (sentence,) = [one for one in exported.notes if one.startswith(f"{camera.name}:")]
        assert "cv2.fisheye.undistortImage(image, K, D, Knew=K)" in sentence
        assert f"undistort/{file_name(camera.name)}.yaml" in sentence
    assert not any("ndistort" in one for one in export(FORMATS[name], rig_of("pinhole", 0)).notes)


def test_what_starts_at_the_vehicle_needs_to_know_where_it_is():
    for name in ("autoware", "nuscenes"):
        problem = refusal(name, rig_of("pinhole", 0, on_vehicle=False))
        assert "T_vehicle_lidar" in problem.hint and name not in problem.fields["formats"]


def test_an_export_has_the_same_bytes_each_time():
    for name in FORMATS:
        first, second = (export(FORMATS[name], rig_of("pinhole", 0)) for _ in range(2))
        assert first == second


def test_names_inside_of_a_zip_lead_nowhere_else():
    calibrated = rig_of("pinhole", 0)
    strange = type(calibrated)(
        "../../etc", [type(one)(**{**vars(one), "rig": "/a\\b"}) for one in calibrated.cameras]
    )
    for name in FORMATS:
        for inside in files_of(name, strange):
            assert not inside.startswith("/") and ".." not in inside.split("/") and "\\" not in inside


def test_the_page_about_exports_has_every_format_in_its_table():
    page = (Path(__file__).parents[3] / "docs" / "exports.md").read_text(encoding="utf-8")
    rows = {line.split("`")[1]: line for line in page.splitlines() if line.startswith("| `") and line.count("|") == 6}
    assert list(rows) == ["json", *FORMATS]
    for name, one in FORMATS.items():
        said = rows[name].split("|")[4]
        assert ("skew" in said and "no skew" not in said) == one.skew
        assert ("k5" in said) != one.third_radial
        assert ("none" in said) != one.carries_lens and (
            ("all" in said) == ({"brown_conrady", "kannala_brandt"} <= one.lenses and one.carries_lens)
        )
        assert ("but `rational_polynomial`" in said) == (one.lenses == WITHOUT_RATIONAL)


def test_rigs_that_contradict_each_other_and_names_that_fall_together_are_refused():
    """Nothing is written over, and no camera stands where another rig says."""
    good = rig_of("pinhole", 0)
    first, second, third = good.cameras
    moved = replace(second, T_vehicle_lidar=vehicle_mount(1))
    same_frame = replace(second, T_camera_lidar=replace(second.T_camera_lidar, to_frame=first.frame))
    for clash in (moved, same_frame, replace(second, name="FRONT")):
        problem = refusal("opencv", Calibrated("Truck", [first, clash, third]))
        assert problem.hint.startswith("Ask for one camera.")


@pytest.mark.parametrize("name", ["ros2", "urdf"])
@pytest.mark.parametrize("frame", ["$(command 'touch /tmp/x')", "my lidar;reboot", "${x}", "caméra"])
def test_a_frame_that_readers_may_take_for_a_command_is_refused(name, frame):
    (camera, *_) = rig_of("pinhole", 0).cameras
    named = replace(camera, T_camera_lidar=replace(camera.T_camera_lidar, to_frame=frame))
    assert "plainly" in refusal(name, Calibrated("Truck", [named])).hint
