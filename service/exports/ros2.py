"""ROS 2: camera_info, the arguments of ``static_transform_publisher``, and a launch file of the solved edges.

Of the tree, each camera's solved edge alone: the vehicle's own description publishes all others, and tf2 takes one
parent of a frame.
"""

from __future__ import annotations

import re
from xml.sax.saxutils import quoteattr

from apexcal.geometry.se3 import SE3
from service.exports.calibrated import Calibrated, file_name, solved_edge
from service.exports.camera_info import camera_info
from service.exports.format import Files, Format


def arguments(pose: SE3) -> list[tuple[str, str]]:
    """Names and values: the child frame's pose in the frame."""
    values = [*(float(part) for part in pose.t), *pose.quaternion_xyzw]
    named = zip(("x", "y", "z", "qx", "qy", "qz", "qw"), map(_decimal, values), strict=True)
    return [*named, ("frame-id", pose.to_frame), ("child-frame-id", pose.from_frame)]


def _decimal(value: float) -> str:
    # Some versions of the program take no exponents.
    text = f"{value:.17f}".rstrip("0")
    return text + "0" if text.endswith(".") else text


def _files(calibrated: Calibrated) -> Files:
    lines: list[str] = []
    nodes: list[str] = []
    for pose in map(solved_edge, calibrated.cameras):
        # A node's name has letters, digits and _ alone, and begins with no digit.
        name = re.sub(r"[^A-Za-z0-9_]", "_", f"static_{pose.to_frame}_to_{pose.from_frame}")
        lines.append(" ".join(f"--{option} {value}" for option, value in arguments(pose)))
        args = quoteattr(lines[-1])
        nodes.append(f'  <node pkg="tf2_ros" exec="static_transform_publisher" name={quoteattr(name)} args={args}/>')
    note = "<!-- Each mount holds with the camera_info.yaml of this export: load both. -->"
    return {
        **{f"{file_name(camera.name)}/camera_info.yaml": camera_info(camera) for camera in calibrated.cameras},
        "static_transform_publisher.txt": "\n".join([*lines, ""]),
        "static_transforms.launch.xml": "\n".join(
            ['<?xml version="1.0"?>', note, "<launch>", *nodes, "</launch>", ""]
        ),
    }


FORMAT = Format(
    name="ros2",
    title="ROS 2",
    write=_files,
    kind="zip",
    direction="the child frame's pose in its parent: T_lidar_camera, or the rig's T_parent_child",
    mount_apart=True,
    plain_frames=True,
)
