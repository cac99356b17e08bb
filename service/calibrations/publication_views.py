"""Current and earlier publications of cameras: by whom, when, why, and against which objections."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Any
from uuid import UUID

from sqlalchemy import Row, Select, Uuid, literal, select, tuple_
from sqlalchemy.exc import NoResultFound
from sqlalchemy.orm import Session

from apexcal.documents.publications import OverrideView, PublicationView
from service.calibration_runs.publication_actions import current_id, current_ids
from service.db.base import Json
from service.db.calibrations import NEWNESS, Calibration, Publication, Result
from service.db.clock import Instant
from service.db.fleets import Rig
from service.db.people import Person
from service.http.pages import Page, Window
from service.http.problems import Problem


def publication_page(session: Session, vehicle_id: UUID, camera: str, window: Window) -> Page[PublicationView]:
    """One page of what a camera was given, the newest first."""
    statement = _rows().where(Publication.vehicle_id == vehicle_id, Publication.camera == camera)
    if window.after is not None:
        statement = statement.where(_older_than(session, vehicle_id, camera, window.after))
    rows = session.execute(statement.order_by(*(key.desc() for key in NEWNESS)).limit(window.limit + 1)).all()
    current = session.scalar(current_id(vehicle_id, camera))
    items = [_view(row, is_current=row[0].id == current) for row in rows[: window.limit]]
    return Page(items=items, next=items[-1].id.hex if len(rows) > window.limit else None)


def publication_view(session: Session, publication: Publication) -> PublicationView:
    """A publication that is its camera's current one."""
    return _view(session.execute(_rows().where(Publication.id == publication.id)).one(), is_current=True)


def current_document(session: Session, vehicle_id: UUID, camera: str) -> Json | None:
    """What a camera is given now: intrinsics and transform together, both frames named. None: nothing yet."""
    current = Publication.id == current_id(vehicle_id, camera).scalar_subquery()
    found = session.execute(_given().where(current)).one_or_none()
    return None if found is None else _document(found)


def vehicle_documents(
    session: Session, vehicle_id: UUID, cameras: Sequence[str], as_of: datetime | None
) -> dict[str, Json]:
    """What each camera of a vehicle is given now, or was at a moment; ``cameras`` limits it to some. By camera."""
    of = [Publication.vehicle_id == vehicle_id]
    if cameras:
        of.append(Publication.camera.in_(cameras))
    if as_of is not None:
        of.append(Publication.created_at <= as_of)
    rows = session.execute(_given().where(Publication.id.in_(current_ids(*of))).order_by(Publication.camera)).all()
    return {row[0].camera: _document(row) for row in rows}


def _given() -> Select[Publication, Result, Calibration, Rig, str]:
    """A query that reads all in one statement: rows may be deleted between two."""
    return (
        select(Publication, Result, Calibration, Rig, Person.name)
        .join(Result, Result.id == Publication.result_id)
        .join(Calibration, Calibration.id == Result.calibration_id)
        .join(Rig, Rig.id == Calibration.rig_id)
        .outerjoin(Person, Person.id == Publication.published_by)
    )


def _document(found: Row[Publication, Result, Calibration, Rig, str]) -> Json:
    publication, result, calibration, rig, published_by = found
    document: dict[str, Any] = {
        "vehicle_id": str(publication.vehicle_id),
        "camera": publication.camera,
        "published_at": publication.created_at,
        "published_by": published_by,
        "reason": publication.reason,
        "override": _override(publication),
        "publication_id": str(publication.id),
        "result_id": str(result.id),
        "calibration_id": str(calibration.id),
        "model": result.model,
        "intrinsics": result.document["intrinsics"],
        "T_camera_lidar": result.document["transform"],
        "quality": _quality(result, calibration),
    }
    if rig.T_vehicle_lidar:
        # Imported here: it needs NumPy, which takes a twentieth of the start.
        from service.calibration_runs.transforms import T_vehicle_camera

        document["T_vehicle_camera"] = T_vehicle_camera(rig.T_vehicle_lidar, result.document["transform"])
    return document


def _rows() -> Select[Publication, UUID, str, str]:
    """A query for (publication, its calibration's id, its model, the name of who published it)."""
    return (
        select(Publication, Result.calibration_id, Result.model, Person.name)
        .join(Result, Result.id == Publication.result_id)
        .outerjoin(Person, Person.id == Publication.published_by)
    )


def _older_than(session: Session, vehicle_id: UUID, camera: str, cursor: str) -> Any:
    """Raises :class:`Problem` ``invalid_cursor`` where the cursor is no publication of this camera."""
    of_camera = select(*NEWNESS).where(Publication.vehicle_id == vehicle_id, Publication.camera == camera)
    try:
        edge = session.execute(of_camera.where(Publication.id == UUID(hex=cursor))).one()
    except (ValueError, NoResultFound):
        raise Problem(
            422, "invalid_cursor", f"`after` is no cursor of this list: {cursor!r}.", "Give the `next` of a page."
        ) from None
    place, created_at, id = edge
    return tuple_(*NEWNESS) < tuple_(place, literal(created_at, Instant()), literal(id, Uuid()))


def _view(row: Row[Publication, UUID, str, str], *, is_current: bool) -> PublicationView:
    publication, calibration_id, model, published_by = row
    return PublicationView(
        id=publication.id,
        fleet_id=publication.fleet_id,
        vehicle_id=publication.vehicle_id,
        camera=publication.camera,
        result_id=publication.result_id,
        calibration_id=calibration_id,
        model=model,
        published_at=publication.created_at,
        published_by=published_by,
        reason=publication.reason,
        override=_override(publication),
        is_current=is_current,
    )


def _override(publication: Publication) -> OverrideView | None:
    if not publication.overridden:
        return None
    return OverrideView(reason=publication.reason or "", objections=publication.overridden)


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
