"""Rigs as the answers show them."""

from __future__ import annotations

from apexcal.documents.base import stored
from apexcal.documents.fleets import RigOut
from service.platform.db.fleets import Rig


def rig_view(rig: Rig) -> RigOut:
    """A rig's row as the outside sees it."""
    return RigOut(
        id=rig.id,
        fleet_id=rig.fleet_id,
        vehicle_id=rig.vehicle_id,
        name=rig.name,
        lidar=stored({"frame": rig.lidar_frame, "topic": rig.lidar_topic, "serial": rig.lidar_serial}),
        T_vehicle_lidar=stored(rig.T_vehicle_lidar),
        cameras=stored(
            [
                {
                    "name": camera.name,
                    "frame": camera.frame,
                    "topic": camera.topic,
                    "serial": camera.serial,
                    "image_size": [camera.image_width, camera.image_height],
                    "nominal": camera.nominal,
                    "joint": camera.joint,
                    "images": camera.images,
                    "bounds": camera.bounds,
                }
                for camera in rig.cameras
            ]
        ),
        camera_transforms=stored(rig.camera_transforms or []),
        policy=stored(rig.policy),
        version=rig.version,
        created_at=rig.created_at,
    )
