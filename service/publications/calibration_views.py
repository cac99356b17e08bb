"""The calibrations that vehicles get, as documents: lens, transforms, quality, and for which sensors they hold."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from sqlalchemy.orm import Session

from apexcal.documents.published_calibrations import Quality
from apexcal.geometry.image_frames import T_images_camera, between, joint_of_images
from service.platform.db.base import Json
from service.platform.db.calibrations import Result
from service.platform.db.fleets import Vehicle
from service.publications.camera_queries import PublishedCamera, next_moves, published_cameras
from service.publications.mounted_sensors import cameras_of
from service.publications.selection import Selection
from service.publications.views import override_view


def vehicle_document(session: Session, vehicle: Vehicle, selection: Selection) -> Json:
    """All selected cameras in one document. Raises :class:`Problem` as :func:`published_cameras`."""
    cameras = camera_documents(session, vehicle, selection)
    without = [] if selection.cameras else sorted(cameras_of(session, vehicle.id) - set(cameras))
    return {
        "vehicle_id": vehicle.id,
        "vehicle": vehicle.name,
        "alias": selection.alias,
        "as_of": selection.as_of,
        "cameras": cameras,
        "without": without,
    }


def camera_documents(session: Session, vehicle: Vehicle, selection: Selection) -> dict[str, Json]:
    """A document for each camera, by name. Raises :class:`Problem` as :func:`published_cameras`."""
    published = published_cameras(session, vehicle, selection)
    as_of = selection.as_of
    until = {} if as_of is None else next_moves(session, vehicle.id, selection.alias, as_of)
    return {name: _document(camera, until.get(name)) for name, camera in published.items()}


def _document(camera: PublishedCamera, until: datetime | None) -> Json:
    publication, result, rig, mount = camera.publication, camera.result, camera.rig, camera.mount
    turn = T_images_camera(mount.frame, mount.images)
    joint = joint_of_images(mount.joint, turn, rig.lidar.frame)
    transform: Json = result.document["transform"] | {"to_frame": turn["to_frame"]}
    document: dict[str, Any] = {
        "vehicle_id": str(publication.vehicle_id),
        "camera": camera.camera,
        "alias": publication.alias,
        "published_at": publication.created_at,
        "published_by": camera.published_by,
        "reason": publication.reason,
        "override": override_view(publication),
        "publication_id": str(publication.id),
        "result_id": str(result.id),
        "calibration_id": str(camera.calibration.id),
        "model": result.model,
        "intrinsics": result.document["intrinsics"],
        "T_camera_lidar": transform,
        "clock_offset_ns": camera.clock_offset_ns,
        "validity": {
            "since": publication.created_at,
            "until": until,
            "camera_serial": mount.serial,
            "lidar_serial": rig.lidar.serial,
        },
        "quality": _quality(result).model_dump(),
    }
    if rig.lidar.T_vehicle_lidar:
        document["T_vehicle_camera"] = between(rig.lidar.T_vehicle_lidar, transform)
    if joint:
        T_parent_camera = between(joint["T_parent_lidar"], transform)
        document["T_parent_child"] = between(T_parent_camera, joint["T_child_camera"])
    return document


def _quality(result: Result) -> Quality:
    fit, summary = result.fit, result.summary
    stated = result.spread or fit
    return Quality(
        pairs=fit.pairs,
        mean_px=fit.polished.mean_px,
        rms_px=fit.polished.rms_px,
        heldout_mean_px=summary and summary.heldout_mean_px,
        heldout_rms_px=summary and summary.heldout_rms_px,
        std=stated.std,
        std_of_model=fit.std,
        interval95_half_width=stated.interval95_half_width,
        verdict=result.verdict,
    )
