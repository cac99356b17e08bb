"""Publications of cameras and moves of their aliases: by whom, when, why, and against which objections."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any
from uuid import UUID

from sqlalchemy import Row, Select, Uuid, func, literal, select, tuple_
from sqlalchemy.exc import NoResultFound
from sqlalchemy.orm import Session

from apexcal.documents.base import stored
from apexcal.documents.publications import AliasMoveView, OverrideView, PublicationView, WithdrawalView
from service.calibration_runs.publication_actions import current_publication, is_withdrawn, withdrawal_of
from service.db.aliases import AliasMove, Withdrawal
from service.db.calibrations import NEWNESS, Publication, Result
from service.db.clock import Instant
from service.db.people import Person
from service.exports.given_queries import withdrawals
from service.http.pages import Page, Window
from service.http.problems import Problem


def publication_page(session: Session, vehicle_id: UUID, camera: str, window: Window) -> Page[PublicationView]:
    """One page of what a camera was given, the newest first."""
    statement = _rows().where(Publication.vehicle_id == vehicle_id, Publication.camera == camera)
    if window.after is not None:
        statement = statement.where(_older_than(session, vehicle_id, camera, window.after))
    rows = session.execute(statement.order_by(*(key.desc() for key in NEWNESS)).limit(window.limit + 1)).all()
    newest = current_publication(session, vehicle_id, camera)
    current = newest.id if newest and not is_withdrawn(session, newest) else None
    of_camera = (Withdrawal.vehicle_id == vehicle_id, Withdrawal.camera == camera)
    withdrawn = {row.number: _withdrawal(row, by) for row, by in session.execute(withdrawals(*of_camera))}
    items = [_view(row, withdrawn, is_current=row[0].id == current) for row in rows[: window.limit]]
    return Page(items=items, next=items[-1].id.hex if len(rows) > window.limit else None)


def publication_view(session: Session, publication: Publication) -> PublicationView:
    """A publication that was its camera's newest when it was read; current unless it is withdrawn."""
    row = session.execute(_rows().where(Publication.id == publication.id)).one()
    known = withdrawal_of(session, publication)
    of_row = session.execute(withdrawals(Withdrawal.id == known.id)).all() if known else ()
    withdrawn = {one.number: _withdrawal(one, by) for one, by in of_row}
    return _view(row, withdrawn, is_current=not withdrawn)


def alias_moves(session: Session, vehicle_id: UUID, camera: str, alias: str, window: Window) -> Page[AliasMoveView]:
    """One page of the moves of an alias, the newest first. The cursor is the number of the last on the page."""
    where = (AliasMove.vehicle_id == vehicle_id, AliasMove.camera == camera, AliasMove.alias == alias)
    statement = _moves().where(*where).order_by(AliasMove.number.desc()).limit(window.limit + 1)
    if window.after is not None:
        if not (window.after.isdecimal() and len(window.after) < 10):
            raise _no_cursor(window.after)
        statement = statement.where(AliasMove.number < int(window.after))
    newest = session.scalar(select(func.max(AliasMove.number)).where(*where))
    rows = session.execute(statement).all()
    items = [_move_view(row, is_current=row[0].number == newest) for row in rows[: window.limit]]
    return Page(items=items, next=str(rows[window.limit - 1][0].number) if len(rows) > window.limit else None)


def newest_moves_view(session: Session, moves: Sequence[AliasMove]) -> list[AliasMoveView]:
    """The last move of each alias, by its name."""
    rows = session.execute(_moves().where(AliasMove.id.in_([one.id for one in moves])).order_by(AliasMove.alias))
    return [_move_view(row, is_current=True) for row in rows]


def _moves() -> Select[AliasMove, UUID, str, str]:
    return (
        select(AliasMove, Result.calibration_id, Result.model, Person.name)
        .outerjoin(Result, Result.id == AliasMove.result_id)
        .outerjoin(Person, Person.id == AliasMove.said_by)
    )


def _move_view(row: Row[AliasMove, UUID, str, str], *, is_current: bool) -> AliasMoveView:
    move, calibration_id, model, moved_by = row
    return AliasMoveView(
        **_shared(move, calibration_id, model),
        alias=move.alias,
        # Older versions of the service write no led_to.
        led_to=move.led_to or move.result_id,
        moved_at=move.created_at,
        moved_by=moved_by,
        is_current=is_current,
    )


def _withdrawal(row: Withdrawal, by: str | None) -> WithdrawalView:
    return WithdrawalView(withdrawn_at=row.created_at, withdrawn_by=by, reason=row.reason)


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
        raise _no_cursor(cursor) from None
    place, created_at, id = edge
    return tuple_(*NEWNESS) < tuple_(place, literal(created_at, Instant()), literal(id, Uuid()))


def _no_cursor(cursor: str) -> Problem:
    return Problem(
        422, "invalid_cursor", f"`after` is no cursor of this list: {cursor!r}.", "Give the `next` of a page."
    )


def _view(
    row: Row[Publication, UUID, str, str], withdrawn: Mapping[int, WithdrawalView], *, is_current: bool
) -> PublicationView:
    publication, calibration_id, model, published_by = row
    return PublicationView(
        **_shared(publication, calibration_id, model),
        published_at=publication.created_at,
        published_by=published_by,
        is_current=is_current,
        withdrawn=None if publication.number is None else withdrawn.get(publication.number),
    )


def _shared(move: Publication | AliasMove, calibration_id: UUID | None, model: str | None) -> dict[str, Any]:
    """What a publication and an alias's move say alike."""
    return {
        "id": move.id,
        "fleet_id": move.fleet_id,
        "vehicle_id": move.vehicle_id,
        "camera": move.camera,
        "result_id": move.result_id,
        "calibration_id": calibration_id,
        "model": model,
        "reason": move.reason,
        "override": override_view(move),
        "gate": stored(move.gate),
    }


def override_view(move: Publication | AliasMove) -> OverrideView | None:
    """The objections against which it was published."""
    if not move.overridden:
        return None
    return OverrideView(reason=move.reason or "", objections=move.overridden)
