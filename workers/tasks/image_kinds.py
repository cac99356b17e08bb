"""Whether images are raw or rectified: what a recording tells of it is kept in the rig, unless the rig says it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from sqlalchemy import select
from sqlalchemy.orm import Session

from service.db.base import Json
from service.db.fleets import Rig, RigCamera
from workers.geometry.rotations import vector_from_rotation
from workers.geometry.transforms import from_document
from workers.readers.normalised.manifest import SensorManifest

# Below a tenth of a pixel for every lens; a driver writes its R with more digits.
_SAME_DEG = 0.005


def keep_image_kinds(session: Session, rig_id: object, sensors: Sequence[SensorManifest]) -> list[str]:
    """State in the rig what the recording tells of its cameras' images; sentences for the recording's owner."""
    cameras = {one.name: one for one in session.scalars(select(RigCamera).where(RigCamera.rig_id == rig_id))}
    said: list[str] = []
    for sensor in sensors:
        camera = cameras.get(sensor.name)
        if camera is None:
            continue
        if camera.images is None and sensor.image_kind is not None:
            camera.images = {"kind": sensor.image_kind, "R": _turn(sensor)}
            session.get_one(Rig, rig_id).version += 1
            said += _decided(camera, sensor)
        elif camera.images is None:
            said += _undecided(sensor)
        else:
            said += _contradictions(camera.images, sensor)
    return said


def _turn(sensor: SensorManifest) -> list[list[float]] | None:
    """R of rectified images by rows, exactly orthonormal; None where it is not stated, or no turn."""
    R = (sensor.camera_info or {}).get("R")
    if R is None or sensor.image_kind == "raw":
        return None
    rows = np.reshape(R, (3, 3)).tolist()
    turn = from_document({"to_frame": "images", "from_frame": "camera", "rotation": {"matrix": rows}}).R
    return turn.tolist() if _degrees(turn) > _SAME_DEG else None


def _degrees(R: object) -> float:
    return float(np.degrees(np.linalg.norm(vector_from_rotation(np.array(R)))))


def _decided(camera: RigCamera, sensor: SensorManifest) -> list[str]:
    if sensor.image_kind == "raw":
        return []
    turn = (camera.images or {}).get("R")
    frame = f" and their frame is {_degrees(turn):.2f} degrees turned from {camera.frame}" if turn else ""
    lens = "their lens is P of the camera info" if sensor.camera_info else "their lens has no distortion"
    return [
        f"{camera.name}: images of {sensor.topic} are rectified, so {lens}{frame}. The rig says so from now "
        "on; correct it there if it is wrong."
    ]


def _undecided(sensor: SensorManifest) -> list[str]:
    info = sensor.camera_info or {}
    if not any(info.get("D", ())) and info.get("P") is None:
        return []
    return [
        f"{sensor.name}: neither the topic {sensor.topic} nor its camera info tells whether images are raw or "
        "rectified. They are taken for raw, with the lens K and D. Say in the rig what they are."
    ]


def _contradictions(images: Json, sensor: SensorManifest) -> list[str]:
    kind, turn = images["kind"], images.get("R")
    if sensor.image_kind not in (None, kind):
        return [
            f"{sensor.name}: images of {sensor.topic} look {sensor.image_kind}, and the rig says {kind}. The rig was "
            "followed. Correct it, or choose another topic and read the recording again."
        ]
    own = _turn(sensor)
    off_deg = _degrees(np.array(own or np.eye(3)) @ np.array(turn or np.eye(3)).T)
    if kind == "raw" or (sensor.camera_info or {}).get("R") is None or off_deg <= _SAME_DEG:
        return []
    return [
        f"{sensor.name}: R of the camera info is {off_deg:.2f} degrees from the R of the rig. The rig was followed. "
        "If the camera was calibrated anew, it needs another rig."
    ]
