"""What vehicles are given, as documents: lens, transforms, quality, and for which sensors they hold."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from typing import Any
from uuid import UUID

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from apexcal.documents.publications import CURRENT
from service.calibration_runs.image_frames import T_images_camera, joint_of_images
from service.calibrations.publication_views import override_view
from service.db.aliases import AliasMove, Withdrawal
from service.db.base import Json
from service.db.calibrations import Calibration, Publication, Result
from service.db.fleets import Rig, RigCamera, Vehicle
from service.exports.given_queries import Asked, Given, given


def given_documents(session: Session, vehicle: Vehicle, asked: Asked) -> dict[str, Json]:
    """A document for each camera, by name. Raises :class:`Problem` as :func:`service.exports.given_queries.given`."""
    found = given(session, vehicle, asked)
    until = _until(session, vehicle.id, found, asked.alias, asked.as_of) if asked.as_of is not None else {}
    return {camera: _document(one, asked.alias, until.get(camera)) for camera, one in found.items()}


def cameras_of(session: Session, vehicle_id: UUID) -> set[str]:
    """The names of the cameras of all its rigs."""
    names = select(RigCamera.name).join(Rig, Rig.id == RigCamera.rig_id).where(Rig.vehicle_id == vehicle_id)
    return set(session.scalars(names))


def _document(one: Given, alias: str, until: datetime | None) -> Json:
    move, result, rig = one.move, one.result, one.rig
    turn = T_images_camera(one.frame, one.images)
    joint = joint_of_images(one.joint, turn, rig.lidar_frame)
    transform: Json = result.document["transform"] | {"to_frame": turn["to_frame"]}
    document: dict[str, Any] = {
        "vehicle_id": str(move.vehicle_id),
        "camera": one.camera,
        "alias": alias,
        "published_at": move.created_at,
        "published_by": one.by,
        "reason": move.reason,
        "override": override_view(move),
        "publication_id": str(move.id),
        "result_id": str(result.id),
        "calibration_id": str(one.calibration.id),
        "model": result.model,
        "intrinsics": result.document["intrinsics"],
        "T_camera_lidar": transform,
        "clock_offset_ns": one.clock_offset_ns,
        "validity": {
            "since": move.created_at,
            "until": until,
            "camera_serial": one.camera_serial,
            "lidar_serial": rig.lidar_serial,
        },
        "quality": _quality(result, one.calibration),
    }
    if rig.T_vehicle_lidar:
        # Imported here: it needs NumPy, which takes a twentieth of the start.
        from service.calibration_runs.transforms import T_vehicle_camera

        document["T_vehicle_camera"] = T_vehicle_camera(rig.T_vehicle_lidar, transform)
    if joint:
        from service.calibration_runs.transforms import T_parent_child

        document["T_parent_child"] = T_parent_child(joint, transform)
    return document


def _until(
    session: Session, vehicle_id: UUID, found: Mapping[str, Given], alias: str, as_of: datetime
) -> dict[str, datetime]:
    """By camera, when something else came after a moment, or what was given then was withdrawn."""
    move: Any = Publication if alias == CURRENT else AliasMove
    of = [move.vehicle_id == vehicle_id, move.created_at > as_of]
    if move is AliasMove:
        of.append(AliasMove.alias == alias)
    rows = session.execute(select(move.camera, func.min(move.created_at)).where(*of).group_by(move.camera))
    first: dict[str, datetime] = {row[0]: row[1] for row in rows}
    if alias != CURRENT:
        return first
    later = (Withdrawal.vehicle_id == vehicle_id, Withdrawal.created_at > as_of)
    for row in session.scalars(select(Withdrawal).where(*later)):
        one = found.get(row.camera)
        # One of an older publication took nothing away.
        if one is not None and one.move.number is not None and one.move.number <= row.number:
            first[row.camera] = min(row.created_at, first.get(row.camera, row.created_at))
    return first


def _quality(result: Result, calibration: Calibration) -> Json:
    cameras: Json = (calibration.summary or {}).get("cameras", {})
    summary: Json = cameras.get(result.camera, {}).get("models", {}).get(result.model, {})
    polished = result.document["polished"]
    # Calibrations before decision 0045 have none.
    stated: Json = summary.get("between_models") or result.document
    return {
        "pairs": result.document.get("pairs"),
        "mean_px": polished["mean_px"],
        "rms_px": polished["rms_px"],
        "heldout_mean_px": summary.get("heldout_mean_px"),
        "heldout_rms_px": summary.get("heldout_rms_px"),
        "std": stated.get("std"),
        "std_of_model": result.document.get("std"),
        "interval95_half_width": stated.get("interval95_half_width"),
        "alarms": result.document.get("alarms", []),
    }
