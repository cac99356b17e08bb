"""The intrinsics that a recording states of its cameras, as bounds to look within."""

from __future__ import annotations

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.db.base import Json
from service.db.calibrations import CorrespondenceSet
from service.db.fleets import RigCamera
from service.db.recordings import Sensor
from service.http.problems import Problem

# How far a stated focal length may be off, as a share of itself, and a principal point, as a share of the image.
_FOCAL_SHARE = 0.10
_CENTRE_SHARE = 0.05


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
            "Leave intrinsics_from out, or give bounds.",
        )
    if (stated["width"], stated["height"]) != (camera.image_width, camera.image_height):
        raise Problem(
            422,
            "intrinsics_of_another_size",
            f"The recording states intrinsics of {camera.name} for {stated['width']} x {stated['height']} pixels, "
            f"and its images have {camera.image_width} x {camera.image_height}.",
            "Leave intrinsics_from out, or give bounds.",
        )
    return stated


def near_stated(stated: Json) -> dict[str, list[float]]:
    """Bounds about the stated focal lengths and principal point, pixels."""
    f_x, _, c_x, _, f_y, c_y = stated["K"][:6]
    across, down = _CENTRE_SHARE * stated["width"], _CENTRE_SHARE * stated["height"]
    return {
        "f_x": [f_x * (1.0 - _FOCAL_SHARE), f_x * (1.0 + _FOCAL_SHARE)],
        "f_y": [f_y * (1.0 - _FOCAL_SHARE), f_y * (1.0 + _FOCAL_SHARE)],
        "c_x": [c_x - across, c_x + across],
        "c_y": [c_y - down, c_y + down],
    }
