"""URDF: links and fixed joints. A joint's origin is the child's pose in its parent."""

from __future__ import annotations

from xml.sax.saxutils import quoteattr

from apexcal.geometry.se3 import SE3
from service.exports.calibrated import Calibrated, file_name, poses
from service.exports.format import Files, Format, numbers


def origin(pose: SE3) -> str:
    """The element of a pose: metres, and radians about the fixed axes x, y, z of the parent."""
    xyz, rpy = (" ".join(map(repr, numbers(values))) for values in (pose.t, pose.roll_pitch_yaw))
    return f'<origin xyz="{xyz}" rpy="{rpy}"/>'


def _files(calibrated: Calibrated) -> Files:
    joints = poses(calibrated)
    links = dict.fromkeys([*(pose.to_frame for pose in joints), *(pose.from_frame for pose in joints)])
    lines = ['<?xml version="1.0"?>', f"<robot name={quoteattr(file_name(calibrated.vehicle))}>"]
    # A comment holds no double hyphen.
    lines += [f"  <!-- {camera.needs().replace('--', '__')} -->" for camera in calibrated.cameras]
    lines += [f"  <link name={quoteattr(link)}/>" for link in links]
    for pose in joints:
        lines += [
            f'  <joint name={quoteattr(f"{pose.to_frame}_to_{pose.from_frame}")} type="fixed">',
            f"    <parent link={quoteattr(pose.to_frame)}/>",
            f"    <child link={quoteattr(pose.from_frame)}/>",
            f"    {origin(pose)}",
            "  </joint>",
        ]
    return {f"{file_name(calibrated.vehicle)}.urdf": "\n".join([*lines, "</robot>", ""])}


FORMAT = Format(
    name="urdf",
    title="URDF",
    write=_files,
    kind="xml",
    direction="the child link's pose in its parent: T_lidar_camera or the rig's T_parent_child, T_vehicle_lidar",
    carries_lens=False,
    one_tree=True,
    plain_frames=True,
)
