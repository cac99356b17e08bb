"""Autoware's ``individual_params`` tree: poses as x y z (metres) and roll pitch yaw (radians) below their parents."""

from __future__ import annotations

import json

from apexcal.geometry.rotations import FORWARD_LIDAR_TO_OPTICAL
from apexcal.geometry.se3 import SE3
from service.exports.calibrated import Calibrated, CalibratedCamera, file_name, solved_edge
from service.exports.camera_info import camera_info
from service.exports.format import Files, Format, numbers, yaml_number

_KIT = "sensor_kit_base_link"
_OPTICAL, _BODY = "camera_optical_link", "camera_link"
NAMES = ("x", "y", "z", "roll", "pitch", "yaw")


def _optical_from_body(optical: str, body: str) -> SE3:
    # Autoware's camera description turns camera_link (x forward, y left, z up) into its optical link by itself.
    return SE3(optical, body, FORWARD_LIDAR_TO_OPTICAL)


def mounted_edge(camera: CalibratedCamera) -> SE3:
    """The solved edge. If it ends at the camera's own optical frame, it ends at its ``camera_link`` instead."""
    edge, frame = solved_edge(camera), camera.T_own_lidar.to_frame
    if edge.from_frame != frame:
        return edge
    body = frame.replace(_OPTICAL, _BODY) if frame.endswith(_OPTICAL) else f"{file_name(camera.name)}/{_BODY}"
    return edge @ _optical_from_body(frame, body)


def values(pose: SE3) -> dict[str, str]:
    """Metres, and radians about the fixed axes x, y, z of the parent, as the files write them."""
    numbered = zip(NAMES, numbers([*pose.t, *pose.roll_pitch_yaw]), strict=True)
    return {name: yaml_number(value) for name, value in numbered}


def _trees(edges: list[SE3]) -> str:
    lines: list[str] = []
    for parent in dict.fromkeys(edge.to_frame for edge in edges):
        lines.append(f"{json.dumps(parent, ensure_ascii=False)}:")
        for edge in (edge for edge in edges if edge.to_frame == parent):
            lines.append(f"  {json.dumps(edge.from_frame, ensure_ascii=False)}:")
            lines += [f"    {name}: {value}" for name, value in values(edge).items()]
    return "\n".join(lines) + "\n"


def _lidar_in_kit(calibrated: Calibrated) -> SE3:
    """The LiDAR's pose in the sensor kit: that of a rig, else none, because the kit lies on the LiDAR's frame."""
    first = calibrated.cameras[0]
    stated = [camera.joint.T_parent_lidar for camera in calibrated.cameras if camera.joint]
    stated += [first.T_vehicle_lidar] if first.T_vehicle_lidar else []
    on_lidar = SE3(_KIT, first.lidar_frame)
    return next((edge for edge in stated if edge.to_frame == _KIT), on_lidar)


def _files(calibrated: Calibrated) -> Files:
    """What hangs on the sensor kit stands in its file, all else in the vehicle's."""
    first, T_kit_lidar = calibrated.cameras[0], _lidar_in_kit(calibrated)
    T_vehicle_lidar = first.T_vehicle_lidar
    assert T_vehicle_lidar is not None
    folder = f"individual_params/config/{file_name(calibrated.vehicle)}/{file_name(first.rig)}"
    edges = [mounted_edge(camera) for camera in calibrated.cameras]
    edges = [T_kit_lidar @ edge if edge.to_frame == first.lidar_frame else edge for edge in edges]
    if T_vehicle_lidar.to_frame != _KIT:
        edges.insert(0, T_vehicle_lidar @ T_kit_lidar.inverse())
    on_vehicle = [edge for edge in edges if edge.to_frame != _KIT]
    return {
        **{
            f"{folder}/{file_name(camera.name)}.camera_info.yaml": camera_info(camera)
            for camera in calibrated.cameras
        },
        **({f"{folder}/sensors_calibration.yaml": _trees(on_vehicle)} if on_vehicle else {}),
        f"{folder}/sensor_kit_calibration.yaml": _trees([T_kit_lidar, *(e for e in edges if e.to_frame == _KIT)]),
    }


FORMAT = Format(
    name="autoware",
    title="Autoware",
    write=_files,
    kind="zip",
    direction="the child's pose in its parent, cameras as camera_link (x forward)",
    mount_apart=True,
    needs_vehicle=True,
    one_lidar=True,
)
