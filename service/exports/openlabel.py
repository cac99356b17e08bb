"""ASAM OpenLABEL 1.0: coordinate systems, and the cameras' lenses as properties of their streams."""

from __future__ import annotations

import json
from typing import Any

from service.exports.calibrated import Calibrated, CalibratedCamera, file_name
from service.exports.format import RADIAL_TANGENTIAL, Files, Format
from service.exports.mounts import poses
from service.exports.transform import numbers

Json = dict[str, Any]


def _systems(calibrated: Calibrated) -> Json:
    """Each frame with its pose in its parent; what has no parent is the local coordinate system."""
    systems: Json = {}
    for pose in poses(calibrated):
        parent = systems.setdefault(pose.to_frame, {"type": "local_cs", "parent": "", "children": []})
        parent["children"].append(pose.from_frame)
        systems.setdefault(pose.from_frame, {"children": []}).update(
            type="sensor_cs", parent=pose.to_frame, pose_wrt_parent={"matrix4x4": numbers(pose.matrix)}
        )
    return systems


def _stream(camera: CalibratedCamera) -> Json:
    """A sensor's stream has the name of its coordinate system."""
    lens = {
        "width_px": camera.width,
        "height_px": camera.height,
        "camera_matrix_3x4": [entry for row in camera.K for entry in (*row, 0.0)],
        "distortion_coeffs_1xN": camera.D,
    }
    return {
        "type": "camera",
        "description": camera.name,
        "uri": "",
        "stream_properties": {"intrinsics_pinhole": lens},
    }


def _files(calibrated: Calibrated) -> Files:
    streams: Json = {camera.frame: _stream(camera) for camera in calibrated.cameras}
    for camera in calibrated.cameras:
        streams.setdefault(camera.lidar_frame, {"type": "lidar", "description": "LiDAR", "uri": ""})
    document = {
        "openlabel": {
            "metadata": {"schema_version": "1.0.0", "name": calibrated.vehicle},
            "coordinate_systems": _systems(calibrated),
            "streams": streams,
        }
    }
    return {f"{file_name(calibrated.vehicle)}.openlabel.json": json.dumps(document, indent=2) + "\n"}


FORMAT = Format(
    name="openlabel",
    title="ASAM OpenLABEL",
    write=_files,
    kind="json",
    direction="pose_wrt_parent is the sensor's pose in its parent: T_lidar_camera, T_vehicle_lidar",
    lenses=RADIAL_TANGENTIAL,
    skew=True,
)
