"""The intrinsics that a recording states of its cameras."""

from __future__ import annotations

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.db.base import Json
from service.db.calibrations import CorrespondenceSet
from service.db.fleets import RigCamera
from service.db.recordings import Sensor
from service.http.problems import Problem


def stated_intrinsics(session: Session, camera: RigCamera, pairs: CorrespondenceSet) -> Json:
    """What the recording of these pairs says of the camera (CameraInfo).

    Raises:
        Problem: 422 ``no_intrinsics_stated`` or ``intrinsics_of_another_size``.
    """
    facts = session.scalar(
        select(Sensor.facts).where(Sensor.recording_id == pairs.recording_id, Sensor.name == camera.name)
    )
    stated: Json | None = (facts or {}).get("camera_info")
    if stated is None:
        raise Problem(
            422,
            "no_intrinsics_stated",
            f"The pairs of {camera.name} come from no recording that states its intrinsics.",
            "Do not ask for the recording's (intrinsics_from: recording; --stated), or give the lens as intrinsics.",
        )
    check_size(stated, camera, f"The recording states intrinsics of {camera.name}")
    return stated


def check_size(stated: Json, camera: RigCamera, what: str) -> None:
    """Refuse intrinsics of other images than the camera's: 422 ``intrinsics_of_another_size``."""
    if (stated["width"], stated["height"]) != (camera.image_width, camera.image_height):
        raise Problem(
            422,
            "intrinsics_of_another_size",
            f"{what} for {stated['width']} x {stated['height']} pixels, "
            f"and its images have {camera.image_width} x {camera.image_height}.",
            "Leave them out, scale them to the images' size, or give bounds.",
        )
