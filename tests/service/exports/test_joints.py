"""Cameras of a rig that states their joints: the exported tree holds the joint, and points fall where ours do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from apexcal.geometry.se3 import SE3
from service.exports.calibrated import Calibrated, SolvedJoint, poses
from service.exports.formats import FORMATS, export
from service.platform.http.problems import Problem
from tests.service.exports.readers import READERS
from tests.service.exports.rigs import mount, ours, rig_of, seen, vehicle_mount


def with_joints(*, parent: str = "base_link", on_vehicle: bool = False) -> Calibrated:
    """Every camera hangs on the parent by a joint to its own ``mountN``, but the last, which hangs on the LiDAR."""
    plain = rig_of("pinhole", 0, on_vehicle=on_vehicle)
    T_parent_lidar = replace(vehicle_mount(0), to_frame=parent)
    if parent == "velodyne":
        T_parent_lidar = SE3(parent, parent)
    if on_vehicle and parent != "base_link":
        T_parent_lidar = replace(mount(1, 1), to_frame=parent, from_frame="velodyne")
    joined = [
        replace(
            camera,
            joint=SolvedJoint(
                T_parent_lidar, replace(mount(place, 1), to_frame=f"mount{place}", from_frame=camera.frame)
            ),
        )
        for place, camera in enumerate(plain.cameras[:2])
    ]
    return replace(plain, cameras=[*joined, plain.cameras[2]])


@pytest.mark.parametrize("name", ["ros2", "urdf"])
@pytest.mark.parametrize(
    ("parent", "on_vehicle"), [("base_link", False), ("base_link", True), ("kit", True), ("velodyne", False)]
)
def test_points_fall_where_ours_do(name, parent, on_vehicle):
    calibrated = with_joints(parent=parent, on_vehicle=on_vehicle)
    for camera, projection in zip(calibrated.cameras, READERS[name](calibrated), strict=True):
        assert np.abs(projection(seen(camera)) - ours(camera)).max() < 1e-4
    tree = {pose.from_frame: pose.to_frame for pose in poses(calibrated)}
    assert tree["mount0"] == parent and tree[calibrated.cameras[0].frame] == "mount0"


def test_two_cameras_on_one_joint_are_refused_together():
    calibrated = with_joints()
    first, second, third = calibrated.cameras
    same = replace(
        second,
        joint=SolvedJoint(second.joint.T_parent_lidar, replace(second.joint.T_child_camera, to_frame="mount0")),
    )
    with pytest.raises(Problem) as refused:
        export(FORMATS["urdf"], replace(calibrated, cameras=[first, same, third]))
    assert "mount0" in refused.value.detail and refused.value.hint.startswith("Ask for one camera.")
