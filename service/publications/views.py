"""Publications as the answers show them: by whom, when, why, and against which checks."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from uuid import UUID

from sqlalchemy import Select, select
from sqlalchemy.orm import Session

from apexcal.documents.fleet_health import CameraHealth
from apexcal.documents.publications import OverrideView, PublicationView
from service.platform.db.calibrations import Publication, Result, moves_of
from service.platform.db.people import Person
from service.platform.http.pages import Page, Window, invalid_cursor
from service.publications.queries import is_newest


def publication_page(
    session: Session, vehicle_id: UUID, camera: str, alias: str, window: Window
) -> Page[PublicationView]:
    """One page of the moves of an alias, the newest first. The cursor is the number of the last on the page."""
    statement = moves_of(vehicle_id, camera, alias)
    if window.after is not None:
        if not (window.after.isascii() and window.after.isdecimal() and len(window.after) < 10):
            raise invalid_cursor(window.after)
        statement = statement.where(Publication.number < int(window.after))
    views = publication_views(session, statement.limit(window.limit + 1))
    items = views[: window.limit]
    return Page(items=items, next=str(items[-1].number) if len(views) > window.limit else None)


def publication_view(session: Session, publication: Publication) -> PublicationView:
    """One publication."""
    return publication_views(session, select(Publication).where(Publication.id == publication.id))[0]


def publication_views(session: Session, statement: Select[Publication]) -> list[PublicationView]:
    """The publications of a query, in its order."""
    rows = session.execute(
        statement.add_columns(Result.calibration_id, Result.model, Person.name, is_newest())
        .outerjoin(Result, Result.id == Publication.result_id)
        .outerjoin(Person, Person.id == Publication.published_by)
    )
    return [
        PublicationView.of(
            row,
            calibration_id=calibration_id,
            model=model,
            published_at=row.created_at,
            published_by=published_by,
            override=override_view(row),
            is_current=bool(is_last) and row.result_id is not None,
        )
        for row, calibration_id, model, published_by, is_last in rows
    ]


def override_view(publication: Publication) -> OverrideView | None:
    """The checks that it did not pass when it was published, and why it was."""
    if not publication.overridden:
        return None
    return OverrideView(reason=publication.reason or "", sentences=publication.overridden)


def health_table(cameras: Sequence[CameraHealth]) -> str:
    """Return cameras as CSV with a header. A name that a spreadsheet would compute has an apostrophe before it."""
    text = io.StringIO()
    writer = csv.DictWriter(text, CameraHealth.model_fields)
    writer.writeheader()
    for camera in cameras:
        row = camera.model_dump(mode="json")
        is_formula = camera.vehicle.startswith(("=", "+", "-", "@"))
        writer.writerow(row | {"vehicle": "'" * is_formula + camera.vehicle})
    return text.getvalue()
