"""A rig and its cameras."""

from __future__ import annotations

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.platform.db.fleets import Rig, RigCamera
from service.platform.http.problems import Problem


def rig_camera(session: Session, rig: Rig, name: str) -> RigCamera:
    """A rig's camera by its name. Raises :class:`Problem` 404 ``unknown_camera`` naming those there are."""
    cameras = session.scalars(select(RigCamera).where(RigCamera.rig_id == rig.id).order_by(RigCamera.position)).all()
    for camera in cameras:
        if camera.name == name:
            return camera
    raise Problem(
        404,
        "unknown_camera",
        f"The rig {rig.name!r} has no camera {name!r}.",
        f"Its cameras are {', '.join(camera.name for camera in cameras)}.",
        cameras=[camera.name for camera in cameras],
    )
