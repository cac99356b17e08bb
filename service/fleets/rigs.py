"""Rigs as the answers show them, and a rig's camera by its name."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

from sqlalchemy import select
from sqlalchemy.orm import Session

from apexcal.documents.fleets import RigOut
from service.platform.db.fleets import Rig, RigCamera
from service.platform.db.recordings import Sensor
from service.platform.http.problems import not_found

Camera = TypeVar("Camera", RigCamera, Sensor)


def rig_camera(session: Session, rig: Rig, name: str) -> RigCamera:
    """A rig's camera by its name. Raises :class:`Problem` 404 ``unknown_camera`` naming those there are."""
    cameras = session.scalars(select(RigCamera).where(RigCamera.rig_id == rig.id).order_by(RigCamera.position)).all()
    return named_camera(cameras, name, f"The rig {rig.name!r}")


def named_camera(cameras: Sequence[Camera], name: str, of: str) -> Camera:
    """The camera of this name. Raises :class:`Problem` 404 ``unknown_camera``, which names those that ``of`` has."""
    for camera in cameras:
        if camera.name == name:
            return camera
    names = [camera.name for camera in cameras]
    hint = f"Its cameras are {', '.join(names)}." if names else "It has none yet."
    raise not_found("unknown_camera", f"{of} has no camera {name!r}.", hint, cameras=names)


def rig_view(rig: Rig) -> RigOut:
    """A rig's row as the outside sees it."""
    names = ("name", "frame", "topic", "serial", "nominal", "joint", "images", "bounds")
    return RigOut.of(
        rig,
        lidar={name: getattr(rig.lidar, name) for name in ("frame", "topic", "serial")},
        T_vehicle_lidar=rig.lidar.T_vehicle_lidar,
        cameras=[
            {name: getattr(camera, name) for name in names}
            | {"image_size": [camera.image_width, camera.image_height]}
            for camera in rig.cameras
        ],
        camera_transforms=rig.camera_transforms or [],
    )
