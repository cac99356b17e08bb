"""Formats that carry the mount alone: for which lens it is, and what their reader is told."""

from __future__ import annotations

import json
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from apexcal.documents.results import StatedLensFit
from service.exports.calibrated import Calibrated
from service.exports.formats import FORMATS, export
from service.platform.db.calibrations import Result
from tests.service.calibrations.test_results import current_address
from tests.service.exports.rigs import rig_of
from tests.service.exports.test_routes import URDF

SENTENCE = "The stated lens leaves 3.1 px RMS, the lens of these pairs 0.7 px."

LENS = {"f_x": 500.0, "f_y": 500.0, "c_x": 320.0, "c_y": 240.0}


def stated_at(translation_m, frames, explains):
    """The mount under a stated lens: level, at this place."""
    rotation = {"matrix": np.eye(3).tolist(), "quaternion_xyzw": [0.0, 0.0, 0.0, 1.0], "euler": []}
    document = {
        "intrinsics": {"model": "pinhole", "image_size": [640, 480]} | LENS,
        "transform": {"to_frame": frames[0], "from_frame": frames[1], "rotation": rotation},
        "rms_px": 3.1,
        "free_lens_rms_px": 0.7,
        "explains": explains,
        "sentence": SENTENCE,
        "sigma_px": 1.0,
        "std": {},
        "interval95_half_width": {},
        "covariance": {"names": [], "units": [], "matrix": []},
    }
    document["transform"]["translation_m"] = translation_m
    return document


@pytest.mark.parametrize(("explains", "takes_stated"), [(True, True), (None, True), (False, False), ("none", False)])
def test_what_carries_no_lens_takes_the_mount_for_the_lens_that_the_vehicle_uses(explains, takes_stated):
    camera = rig_of("pinhole", 0, on_vehicle=False).cameras[0]
    if explains != "none":
        fit = stated_at([0.0, 0.0, 7.0], (camera.frame, camera.lidar_frame), explains)
        camera = replace(camera, stated=StatedLensFit.model_validate(fit))
    calibrated = Calibrated("car", [camera])
    for name, format in FORMATS.items():
        if camera.T_vehicle_lidar is None and format.needs_vehicle:
            continue
        made = export(format, calibrated)
        assert bool(made.notes) == (name in ("urdf", "ros2", "autoware", "fast_livo2")), name
        if name in ("ros2", "autoware"):
            assert f"/v1/results/{camera.source}?format=camera_info" in made.notes[0]
    made = export(FORMATS["urdf"], calibrated)
    joint = ElementTree.fromstring(made.content).find("joint/origin")
    assert joint is not None
    xyz = [float(value) for value in joint.attrib["xyz"].split()]
    assert (xyz == [0.0, 0.0, -7.0]) == takes_stated
    (note,) = made.notes
    assert f"<!-- {note} -->".encode() in made.content
    assert ("the stated lens (CameraInfo)" in note) == takes_stated
    assert (f"/v1/results/{camera.source}?format=camera_info" in note) != takes_stated
    assert (SENTENCE in note) == (explains != "none")


def test_the_answer_says_with_which_lens_a_mount_holds(api, rig, result, viewer):
    def answers():
        asked = {"urdf": URDF, "joint": "mount"}
        return [
            viewer.get(current_address(rig), params={"format": "urdf"}),
            viewer.post(f"/results/{result}/urdf", asked),
            viewer.post(f"{current_address(rig)}/urdf", asked),
        ]

    for answer in answers():
        (note,) = json.loads(answer.headers["apexcal-notes"])
        assert f"/v1/results/{result}?format=camera_info" in note
    with api.database.writing() as session:
        row = session.get_one(Result, result)
        frames = (row.document["transform"]["to_frame"], row.document["transform"]["from_frame"])
        row.document = row.document | {"stated_lens": stated_at([0.0, 0.0, 7.0], frames, True)}
    for answer in answers():
        (note,) = json.loads(answer.headers["apexcal-notes"])
        assert "the stated lens (CameraInfo)" in note and SENTENCE in note
        assert b"-7.0" in answer.content
    ros2 = viewer.get(current_address(rig), params={"format": "ros2"})
    (note,) = json.loads(ros2.headers["apexcal-notes"])
    assert f"/v1/results/{result}?format=camera_info" in note and b"-7.0" not in ros2.content
