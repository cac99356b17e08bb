"""Which edge of the vehicle's tree a calibration changes, and the tree around it."""

from __future__ import annotations

from apexcal.geometry.se3 import SE3
from service.exports.calibrated import Calibrated, CalibratedCamera


def solved_edge(camera: CalibratedCamera) -> SE3:
    """The one edge that the calibration changes: the child's pose in its parent.

    It is the joint that the rig states. Without one it is the optical frame below the LiDAR's.
    """
    return camera.T_parent_child or camera.T_lidar_camera


def poses(calibrated: Calibrated) -> list[SE3]:
    """Each frame's pose in its parent, once: the solved edges, and what joins them to the LiDAR and the vehicle."""
    tree: dict[str, SE3] = {}
    for camera in calibrated.cameras:
        root, edge = calibrated.T_root_lidar(camera.lidar_frame), solved_edge(camera)
        if root is not None:
            tree[camera.lidar_frame] = root
            if camera.joint and edge.to_frame not in (root.to_frame, camera.lidar_frame):
                tree[edge.to_frame] = root @ camera.joint.T_parent_lidar.inverse()
        tree[edge.from_frame] = edge
        if camera.joint and edge.from_frame != camera.frame:
            tree[camera.frame] = camera.joint.T_child_camera
    return list(tree.values())
