"""What vehicles are given, as documents: lens, transforms, quality, and for which sensors they hold."""

from __future__ import annotations

from datetime import datetime
from typing import Any
from uuid import UUID

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from apexcal.documents.publications import CURRENT
from service.calibrations.publication_views import override_view
from service.db.aliases import AliasMove, Withdrawal
from service.db.base import Json
from service.db.calibrations import Calibration, Publication, Result
from service.db.fleets import Rig, RigCamera, Vehicle
from service.exports.given_queries import Asked, Given, given


def given_documents(session: Session, vehicle: Vehicle, asked: Asked) -> dict[str, Json]:
    """A document for each camera, by name. Raises :class:`Problem` as :func:`service.exports.given_queries.given`."""
    found = given(session, vehicle, asked)
    until = _until(session, vehicle.id, asked.alias, asked.as_of) if asked.as_of is not None else {}
    return {camera: _document(one, asked.alias, until.get(camera)) for camera, one in found.items()}


def cameras_of(session: Session, vehicle_id: UUID) -> set[str]:
    """The names of the cameras of all its rigs."""
    names = select(RigCamera.name).join(Rig, Rig.id == RigCamera.rig_id).where(Rig.vehicle_id == vehicle_id)
    return set(session.scalars(names))


def _document(one: Given, alias: str, until: datetime | None) -> Json:
    move, result, rig = one.move, one.result, one.rig
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
        "T_camera_lidar": result.document["transform"],
        "clock_offset_ns": None if one.pairing is None else one.pairing.get("offset_ns", 0),
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

        document["T_vehicle_camera"] = T_vehicle_camera(rig.T_vehicle_lidar, result.document["transform"])
    return document


def _until(session: Session, vehicle_id: UUID, alias: str, as_of: datetime) -> dict[str, datetime]:
    """By camera, when it was next replaced after a moment."""
    tables: tuple[Any, ...] = (Publication, Withdrawal) if alias == CURRENT else (AliasMove,)
    first: dict[str, datetime] = {}
    for table in tables:
        of = [table.vehicle_id == vehicle_id, table.created_at > as_of]
        if table is AliasMove:
            of.append(AliasMove.alias == alias)
        rows = session.execute(select(table.camera, func.min(table.created_at)).where(*of).group_by(table.camera))
        for camera, at in rows:
            first[camera] = min(at, first.get(camera, at))
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
