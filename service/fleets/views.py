"""Rigs as the answers show them."""

from __future__ import annotations

from apexcal.documents.fleets import RigOut
from service.platform.db.fleets import Rig


def rig_view(rig: Rig) -> RigOut:
    """A rig's row as the outside sees it."""
    names = ("name", "frame", "topic", "serial", "nominal", "joint", "images", "bounds")
    return RigOut.of(
        rig,
        lidar={"frame": rig.lidar_frame, "topic": rig.lidar_topic, "serial": rig.lidar_serial},
        cameras=[
            {name: getattr(camera, name) for name in names}
            | {"image_size": [camera.image_width, camera.image_height]}
            for camera in rig.cameras
        ],
        camera_transforms=rig.camera_transforms or [],
    )
