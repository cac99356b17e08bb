"""A vehicle's own URDF with one joint's origin replaced, so that camera and LiDAR lie as they were calibrated.

The joint stands somewhere between the two. What lies on its child's side moves with it; all other joints keep what
they say, and every byte outside of the one origin stays.
"""

from __future__ import annotations

from collections.abc import Mapping

from apexcal.geometry.se3 import SE3
from apexcal.geometry.urdf_tree import UrdfJoint, read_joints, refused
from service.exports.urdf import origin


def patched(document: bytes, joint_name: str, T_camera_lidar: SE3) -> bytes:
    """The file with the new origin of a joint, by its name or its child. The transform's frames are links.

    Raises:
        InputError: ``urdf_not_read``, where the file cannot be used or the joint is not between the two links.
    """
    joints = read_joints(document)
    joint = joints.get(joint_name) or next((each for each in joints.values() if each.child == joint_name), None)
    if joint is None:
        raise refused(f"There is no joint {joint_name!r}.", f"The joints are {', '.join(joints)[:500] or 'none'}.")
    if joint.kind != "fixed":
        raise refused(f"The joint {joint_name!r} is {joint.kind}.", "A calibration is of a fixed joint.")
    twins = [
        name
        for name, other in joints.items()
        if name != joint.name and {other.parent, other.child} == {joint.parent, joint.child}
    ]
    if twins:
        raise refused(
            f"The joint {twins[0]!r} joins the same links as {joint_name!r}.", "Remove the one that is not meant."
        )
    others = {name: other for name, other in joints.items() if name != joint.name}
    T_parent_child = _solved(joint, others, T_camera_lidar)
    element = origin(T_parent_child).encode()
    if joint.origin is not None:
        return document[: joint.origin.begin] + element + document[joint.origin.end :]
    if document[joint.inside - 2 : joint.inside] == b"/>":
        raise refused(f"The joint {joint_name!r} has no parent and child.", "Complete it.")
    return document[: joint.inside] + element + document[joint.inside :]


def _solved(joint: UrdfJoint, others: Mapping[str, UrdfJoint], T_camera_lidar: SE3) -> SE3:
    """``T_parent_child`` of the joint: the calibration between two chains of the other joints."""
    camera, lidar = T_camera_lidar.to_frame, T_camera_lidar.from_frame
    below = _poses_from(joint.child, others)
    above = _poses_from(joint.parent, others)
    for link in (camera, lidar):
        if link not in below and link not in above:
            raise refused(
                f"No fixed joints lead from {joint.name!r} to a link {link!r}.",
                "Name the links of camera and LiDAR (camera_link, lidar_link) as the file does.",
            )
    if camera in below and lidar in above:
        return above[lidar] @ T_camera_lidar.inverse() @ below[camera].inverse()
    if lidar in below and camera in above:
        return above[camera] @ T_camera_lidar @ below[lidar].inverse()
    raise refused(
        f"The joint {joint.name!r} is not between {camera!r} and {lidar!r}: replacing it moves both.",
        "Name a joint on the way from one to the other.",
    )


def _poses_from(link: str, joints: Mapping[str, UrdfJoint]) -> dict[str, SE3]:
    """``T_link_other`` of every link that fixed joints lead to."""
    beside: dict[str, list[SE3]] = {}
    for joint in joints.values():
        if joint.kind == "fixed":
            beside.setdefault(joint.parent, []).append(joint.T_parent_child)
            beside.setdefault(joint.child, []).append(joint.T_parent_child.inverse())
    poses = {link: SE3(link, link)}
    waiting = [link]
    while waiting:
        here = waiting.pop()
        for step in beside.get(here, []):
            if step.from_frame not in poses:
                poses[step.from_frame] = poses[here] @ step
                waiting.append(step.from_frame)
    return poses
