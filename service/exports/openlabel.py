"""ASAM OpenLABEL 1.0: sensors with their poses in one frame, and the cameras' lenses as properties of their streams.

The lens's members are named as the standard's schema names them (raillabel takes no others), and in the format
``vcd`` as the library VCD names them, which reads no others. A fisheye lens has both names: raillabel has no fisheye.
"""

from __future__ import annotations

import json
from functools import partial
from typing import Any

from apexcal.documents.camera_models import ModelName
from apexcal.geometry.se3 import SE3
from service.exports.calibrated import Calibrated, CalibratedCamera, file_name
from service.exports.format import KNOWN_ELSEWHERE, WITHOUT_RATIONAL, Files, Format, numbers

Json = dict[str, Any]
# raillabel takes no other name for the frame that all poses are stated in.
_BASE = "base"


def _pose(T_base_sensor: SE3) -> Json:
    return {"translation": numbers(T_base_sensor.t), "quaternion": numbers(T_base_sensor.quaternion_xyzw)}


def _system(T_base_sensor: SE3) -> Json:
    return {"type": "sensor", "parent": _BASE, "children": [], "pose_wrt_parent": _pose(T_base_sensor)}


def _pinhole(camera: CalibratedCamera, suffixes: tuple[str, str]) -> Json:
    return {
        "intrinsics_pinhole": {
            "width_px": camera.width,
            "height_px": camera.height,
            f"camera_matrix{suffixes[0]}": [entry for row in camera.K for entry in (*row, 0.0)],
            f"distortion_coeffs{suffixes[1]}": camera.D,
        }
    }


def _fisheye(camera: CalibratedCamera) -> Json:
    """VCD's ``kannala``: r = c1 theta + c2 theta^3 + ... + c5 theta^9, theta the angle to the optical axis."""
    (f_x, _, c_x), (_, f_y, c_y), _ = camera.K
    lens = {"width_px": camera.width, "height_px": camera.height, "focal_length_x": f_x, "focal_length_y": f_y}
    coefficients = [1.0, *camera.D]
    lens |= {"center_x_px": c_x, "center_y_px": c_y, "lens_coeffs": coefficients}
    of_vcd = {"model": "kannala", "center_x": c_x, "center_y": c_y, "lens_coeffs_1xN": coefficients}
    return {"intrinsics_fisheye": lens | of_vcd}


def _stream(camera: CalibratedCamera, suffixes: tuple[str, str]) -> Json:
    """A sensor's stream has the name of its coordinate system."""
    lens = _fisheye(camera) if camera.lens == "kannala_brandt" else _pinhole(camera, suffixes)
    return {"type": "camera", "description": camera.name, "uri": "", "stream_properties": lens}


def _files(suffixes: tuple[str, str], calibrated: Calibrated) -> Files:
    """``base`` is the frame that :meth:`Calibrated.T_root_lidar` leads to, else the LiDAR's."""
    systems: Json = {_BASE: {"type": "local", "parent": "", "children": []}}
    streams: Json = {}
    for camera in calibrated.cameras:
        root = calibrated.T_root_lidar(camera.lidar_frame)
        T_base_lidar = root or SE3(camera.lidar_frame, camera.lidar_frame)
        systems[camera.lidar_frame] = _system(T_base_lidar)
        systems[camera.frame] = _system(T_base_lidar @ camera.T_lidar_camera)
        streams[camera.frame] = _stream(camera, suffixes)
        about = f"LiDAR; base is {T_base_lidar.to_frame}"
        streams[camera.lidar_frame] = {"type": "lidar", "description": about, "uri": ""}
    systems[_BASE]["children"] = list(streams)
    document = {
        "openlabel": {
            "metadata": {"schema_version": "1.0.0", "name": calibrated.vehicle},
            "coordinate_systems": systems,
            "streams": streams,
        }
    }
    return {f"{file_name(calibrated.vehicle)}.openlabel.json": json.dumps(document, indent=2) + "\n"}


def _format(name: str, title: str, suffixes: tuple[str, str], lenses: frozenset[ModelName]) -> Format:
    return Format(
        name=name,
        title=title,
        write=partial(_files, suffixes),
        kind="json",
        lenses=lenses,
        direction="pose_wrt_parent is the sensor's pose in the base frame",
        skew=True,
        one_tree=True,
    )


FORMAT = _format("openlabel", "ASAM OpenLABEL", ("", ""), WITHOUT_RATIONAL)
VCD = _format("vcd", "ASAM OpenLABEL for VCD", ("_3x4", "_1xN"), KNOWN_ELSEWHERE)
