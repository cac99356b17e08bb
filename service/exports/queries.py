"""Read the data of an export from the database in one statement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING
from uuid import UUID

from sqlalchemy import Select, and_, select
from sqlalchemy.orm import Session

from apexcal.documents.camera_models import parse_model
from apexcal.geometry.image_frames import T_images_camera, joint_of_images
from service.platform.db.calibrations import Calibration, CalibrationRun, CorrespondenceSet, Result
from service.platform.db.fleets import Rig, RigCamera, Vehicle
from service.platform.http.problems import not_found

if TYPE_CHECKING:
    from apexcal.geometry.se3 import Floats
    from service.exports.calibrated import Calibrated, CalibratedCamera

_Cameras = Select[Result, Rig, RigCamera, str, list[float] | None, list[float] | None]


def of_result(session: Session, result_id: UUID) -> Calibrated:
    """One result. Raises :class:`Problem` 404 where it is gone."""
    return _of(session, _cameras().where(Result.id == result_id))


def of_results(session: Session, result_ids: Sequence[UUID]) -> Calibrated:
    """Several results of one vehicle, in the order of rigs and cameras. Raises :class:`Problem` 404 for none."""
    return _of(session, _cameras().where(Result.id.in_(result_ids)))


def _cameras() -> _Cameras:
    return (
        select(Result, Rig, RigCamera, Vehicle.name, CorrespondenceSet.pairs["u"], CorrespondenceSet.pairs["v"])
        .join(Calibration, Calibration.id == Result.calibration_id)
        .join(CalibrationRun, CalibrationRun.id == Result.run_id)
        .join(CorrespondenceSet, CorrespondenceSet.id == CalibrationRun.set_id)
        .join(Vehicle, Vehicle.id == Calibration.vehicle_id)
        .join(Rig, Rig.id == Calibration.rig_id)
        .join(RigCamera, and_(RigCamera.rig_id == Rig.id, RigCamera.name == Result.camera))
        .order_by(Rig.id, RigCamera.position)
    )


def _of(session: Session, statement: _Cameras) -> Calibrated:
    # Imported here, as below: it needs NumPy, which takes a twentieth of the start.
    import numpy as np

    from service.exports.calibrated import Calibrated

    rows = session.execute(statement).all()
    if not rows:
        raise not_found()
    cameras = [
        _camera(result, rig, camera, np.array([u or [], v or []], np.float64).T)
        for result, rig, camera, _, u, v in rows
    ]
    return Calibrated(rows[0][3], cameras)


def _camera(result: Result, rig: Rig, camera: RigCamera, marked: Floats) -> CalibratedCamera:
    from apexcal.geometry.se3 import from_document
    from service.exports.calibrated import CalibratedCamera, SolvedJoint

    turn = T_images_camera(camera.frame, camera.images)
    joint = joint_of_images(camera.joint, turn, rig.lidar.frame)
    fit = result.fit
    return CalibratedCamera(
        name=camera.name,
        topic=camera.topic,
        width=camera.image_width,
        height=camera.image_height,
        model=parse_model(result.model),
        intrinsics=fit.intrinsics.by_name(),
        T_camera_lidar=replace(from_document(fit.transform), to_frame=turn["to_frame"]),
        T_vehicle_lidar=from_document(rig.lidar.T_vehicle_lidar) if rig.lidar.T_vehicle_lidar else None,
        rig=rig.name,
        source=str(result.id),
        at=result.created_at,
        marked=marked,
        joint=SolvedJoint(*(from_document(joint[name]) for name in ("T_parent_lidar", "T_child_camera")))
        if joint
        else None,
        is_rectified=(camera.images or {}).get("kind") == "rectified",
        T_own_camera=from_document(turn).inverse(),
        stated=fit.stated_lens,
        mount_checks=[check.sentence for check in result.stored_checks if check.is_doubt],
    )
