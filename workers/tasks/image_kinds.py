"""Whether images are raw or rectified: what a recording tells of it is kept in the rig, unless the rig says it."""

from __future__ import annotations

from collections.abc import Sequence
from uuid import UUID

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.platform.db.fleets import Rig, RigCamera
from workers.readers.normalised.manifest import SensorManifest


def keep_image_kinds(session: Session, rig_id: UUID, sensors: Sequence[SensorManifest]) -> list[str]:
    """State in the rig what the recording tells of its cameras' images; sentences for the recording's owner."""
    cameras = {one.name: one for one in session.scalars(select(RigCamera).where(RigCamera.rig_id == rig_id))}
    seen = [(cameras[one.name], one) for one in sensors if one.name in cameras]
    for camera, sensor in seen:
        if camera.images is None and sensor.image_kind is not None:
            R = (sensor.camera_info or {}).get("R") if sensor.image_kind == "rectified" else None
            camera.images = {"kind": sensor.image_kind, "rotation": R and {"matrix": [R[:3], R[3:6], R[6:]]}}
            session.get_one(Rig, rig_id).version += 1
    sentences = (_sentence(camera, sensor) for camera, sensor in seen)
    return [f"{camera.name}: {said}" for (camera, _), said in zip(seen, sentences, strict=True) if said]


def _sentence(camera: RigCamera, sensor: SensorManifest) -> str | None:
    kind, info, topic = sensor.image_kind, sensor.camera_info or {}, sensor.topic
    stated = camera.images["kind"] if camera.images else None
    if stated is None and (info.get("P") or any(info.get("D", ()))):
        return (
            f"neither the topic {topic} nor its camera info tells whether images are raw or rectified. They are "
            "taken for raw, with the lens K and D. Say in the rig what they are."
        )
    if kind is not None and kind != stated:
        return f"images of {topic} look {kind}, and the rig says {stated}. The rig was followed: is it right?"
    if stated == "rectified":
        return f"images of {topic} are rectified. Their lens is P of the camera info, without distortion."
    return None
