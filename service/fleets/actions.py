"""Rigs as rows."""

from __future__ import annotations

from collections.abc import Sequence

from sqlalchemy import select
from sqlalchemy.orm import Session

from apexcal.documents.fleets import Camera, NewRig
from apexcal.documents.rig_proposals import LIDAR
from service.platform.db.base import new_id
from service.platform.db.fleets import Rig, RigCamera, RigLidar, Vehicle


def empty_rig(session: Session, vehicle: Vehicle, name: str) -> Rig:
    """Add a rig without cameras, which its first recording describes. A name that is taken gets a number."""
    taken = set(session.scalars(select(Rig.name).where(Rig.vehicle_id == vehicle.id)))
    # One more number than names: one of them is free.
    numbered = (f"{name[:190]} {number}" for number in range(2, len(taken) + 3))
    free = name if name not in taken else next(each for each in numbered if each not in taken)
    ids = {"id": new_id(), "fleet_id": vehicle.fleet_id, "vehicle_id": vehicle.id}
    lidar = RigLidar(id=new_id(), position=0, name=LIDAR, frame="lidar")
    rig = Rig(**ids, name=free, camera_transforms=[], version=1, lidars=[lidar], cameras=[])
    session.add(rig)
    return rig


def describe(rig: Rig, body: NewRig) -> None:
    """Write a description into a rig that has no cameras yet."""
    if not rig.lidars:
        rig.lidars = [RigLidar(id=new_id(), position=0, name=LIDAR)]
    lidar = rig.lidar
    lidar.frame, lidar.topic, lidar.serial = body.lidar.frame, body.lidar.topic, body.lidar.serial
    lidar.T_vehicle_lidar = body.T_vehicle_lidar and body.T_vehicle_lidar.model_dump(mode="json")
    rig.camera_transforms = [transform.model_dump(mode="json") for transform in body.camera_transforms]
    rig.cameras = _camera_rows(body.cameras)


def _camera_rows(cameras: Sequence[Camera]) -> list[RigCamera]:
    return [
        RigCamera(
            id=new_id(),
            position=position,
            name=camera.name,
            frame=camera.frame,
            topic=camera.topic,
            serial=camera.serial,
            image_width=camera.image_size[0],
            image_height=camera.image_size[1],
            nominal=camera.nominal.model_dump(mode="json"),
            bounds={name: list(pair) for name, pair in camera.bounds.items()},
            joint=camera.joint and camera.joint.model_dump(mode="json"),
            images=camera.images and camera.images.model_dump(mode="json"),
        )
        for position, camera in enumerate(cameras)
    ]
