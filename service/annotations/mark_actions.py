"""Writes what a person says as a row, and keeps which row's mark and which row's verdict stand."""

from __future__ import annotations

from functools import cache
from typing import Any
from uuid import UUID

from sqlalchemy import select, update
from sqlalchemy.orm import Session

from apexcal.documents.corners import TOP
from service.annotations.views import PriorAnswer
from service.platform.db.annotations import Answer
from service.platform.db.base import Json
from service.platform.db.session import upserting
from service.platform.http.problems import unprocessable

_ANSWER: Any = Answer.__table__


def check_inside(u: float, v: float, width: int, height: int) -> None:
    """Raises :class:`Problem` 422 ``mark_outside_image`` for a pixel that is not in an image of this size.

    (0, 0) is the centre of the top-left pixel, so an image reaches from -0.5 to its size minus 0.5.
    """
    if -0.5 <= u <= width - 0.5 and -0.5 <= v <= height - 0.5:
        return
    raise unprocessable(
        "mark_outside_image",
        f"The mark ({u:g}, {v:g}) lies outside the image of {width} x {height} pixels.",
        "u goes from -0.5 on the left to width - 0.5, v from -0.5 at the top to height - 0.5.",
    )


def find_mark(
    session: Session, person_id: UUID, sensor_id: UUID, frame_index: int, corner: str = TOP
) -> Answer | None:
    """The row of a person's mark of a corner in a frame."""
    whose = {"person_id": person_id, "sensor_id": sensor_id, "frame_index": frame_index, "corner": corner}
    return session.scalar(select(Answer).filter_by(**whose).where(Answer.is_mark))


def write_answer(
    session: Session, row: Json, mark: Answer | PriorAnswer | None, verdict: Answer | PriorAnswer | None
) -> bool:
    """Write a row of ``answer``. Its mark and verdict stand from now on, unless those before say the same.

    So what is said again stays as independent as it was. ``mark``, ``verdict``: the rows that stood before on the
    same corner in the frame and on the same apex. Call ``reopen`` first where the verdict changes: a confirmation may
    lack its mark. Returns False where an answer with this id exists.
    """
    u, v, word = row.get("u"), row.get("v"), row.get("verdict")
    takes = {
        "is_mark": u is not None and (mark is None or (mark.u, mark.v) != (u, v)),
        "is_verdict": word is not None and (verdict is None or verdict.verdict != word),
    }
    for name, before in (("is_mark", mark), ("is_verdict", verdict)):
        if before is not None and takes[name]:
            set_standing(session, before.id, **{name: False})
    return session.connection().scalar(_new_answer(session.get_bind().dialect.name), row | takes) is not None


@cache
def _new_answer(dialect: str) -> Any:
    row = upserting(dialect, _ANSWER).on_conflict_do_nothing(index_elements=["id"])
    return row.returning(_ANSWER.c.id)


def set_standing(session: Session, answer_id: UUID, **stands: bool) -> None:
    """Update whether an answer's mark (``is_mark``) and verdict (``is_verdict``) stand; call it after ``reopen``."""
    session.connection().execute(update(_ANSWER).where(_ANSWER.c.id == answer_id).values(**stands))
