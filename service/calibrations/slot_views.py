"""Slots in pages: their key is three columns, so the cursor is too."""

from __future__ import annotations

from uuid import UUID

from sqlalchemy import Select, tuple_
from sqlalchemy.orm import Session

from apexcal.documents.calibrations import SlotView
from service.platform.db.calibrations import CalibrationRun, Slot
from service.platform.http.pages import Page, Window
from service.platform.http.problems import Problem


def slot_page(session: Session, statement: Select[CalibrationRun, Slot], window: Window) -> Page[SlotView]:
    """One page of a query for (CalibrationRun, Slot), run by run, in the order of iterations and slots."""
    key = (Slot.run_id, Slot.iteration, Slot.slot)
    if window.after is not None:
        statement = statement.where(tuple_(*key) > tuple_(*_parse(window.after)))
    rows = session.execute(statement.order_by(*key).limit(window.limit + 1)).all()
    following = None
    if len(rows) > window.limit:
        rows = rows[: window.limit]
        last: Slot = rows[-1][1]
        following = f"{last.run_id.hex}.{last.iteration}.{last.slot}"
    return Page(items=[_view(run, slot) for run, slot in rows], next=following)


def _parse(cursor: str) -> tuple[UUID, int, int]:
    try:
        run_id, iteration, slot = cursor.split(".")
        key = UUID(hex=run_id), int(iteration), int(slot)
        if not all(0 <= number < 2**31 for number in key[1:]):
            raise ValueError(cursor)
        return key
    except ValueError:
        raise Problem(
            422, "invalid_cursor", f"`after` is no cursor of this list: {cursor!r}.", "Give the `next` of a page."
        ) from None


def _view(run: CalibrationRun, slot: Slot) -> SlotView:
    return SlotView(
        camera=run.camera,
        model=run.model,
        fold=run.fold,
        iteration=slot.iteration,
        slot=slot.slot,
        loss=slot.loss,
        parameters=slot.parameters,
        evaluations=slot.evaluations,
        seconds=slot.seconds,
        worker=slot.worker,
    )
