"""Answers to marking tasks, and their undoing.

An id is answered once. An answer replaces the version that the person saw, and a vertex takes ten at most. The
person's lock is held, so that two browser tabs of one person come one after the other.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import Any
from uuid import UUID

from sqlalchemy import bindparam, func, select, update
from sqlalchemy.orm import Session

from apexcal.documents.marking import Answer, AnswerView, Own, Undo
from service.annotations.mark_actions import check_inside, find_mark, set_standing, write_answer
from service.annotations.progress_actions import counted, progress_of
from service.annotations.task_actions import reopen
from service.annotations.views import PriorAnswer, Subject, own_answer, own_version, subjects
from service.platform.db.annotations import Answer as AnswerRow
from service.platform.db.annotations import MarkingTask
from service.platform.db.base import Json
from service.platform.db.clock import now, now_plus
from service.platform.http.problems import Problem, conflict, unprocessable

# People correct themselves once or twice. Each answer stays in the history, so their number is bounded: this many
# rows, and as many for taking them back.
MOST_ANSWERS = 10

_TASK: Any = MarkingTask.__table__
_OF_TASK = update(_TASK).where(_TASK.c.id == bindparam("task"))
_ANSWERED = _OF_TASK.values(answered_at=now())
_LEASED_AGAIN = _OF_TASK.values(answered_at=None, leased_until=now_plus("lease_s"))


def create_answer(session: Session, subject: Subject, answer: Answer) -> AnswerView:
    """Write mark and verdict of a task's vertex. The same id again changes nothing and gives the same row.

    An answer counts also when its lease ran out, and when the vertex has as many answers as wanted already.

    Raises:
        Problem: ``mark_required``, ``mark_outside_image``, ``answer_id_used``, ``answer_changed``,
            ``answered_too_often``.
    """
    verdict, mark = answer.verdict, answer.mark if answer.verdict == "confirmed" else None
    if verdict == "confirmed" and mark is None:
        raise unprocessable(
            "mark_required", "A confirmed corner needs its mark.", 'Send "mark": {"u": ..., "v": ...} in pixels.'
        )
    if mark is not None:
        check_inside(mark.u, mark.v, subject.frame.width, subject.frame.height)
    content: Json = {"verdict": verdict, "u": mark and mark.u, "v": mark and mark.v}
    version, reviewed = answer.version + 1, bool(subject.is_told)
    repeated = _repeated(session, subject, answer, content)
    if repeated is not None:
        version, reviewed = repeated.version, repeated.reviewed
    else:
        if subject.verdict is not None and subject.verdict.verdict != verdict:
            reopen(session, subject.person_id, subject.recording_id, subject.apex_id)
        with _counted(session, subject, subject.frame.frame_index):
            _write(session, subject, answer, content, subject.mark, subject.verdict)
            session.connection().execute(_ANSWERED, {"task": subject.task_id})
    progress = progress_of(session, subject.person_id, subject.detection_id, subject.frame.sensor_id)
    return AnswerView(id=answer.id, version=version, verdict=verdict, mark=mark, reviewed=reviewed, progress=progress)


def undo(session: Session, subject: Subject, undone: Undo, lease_s: float) -> Subject:
    """Take the last answer back, and lease its vertex to the same person again in the same transaction.

    The mark stays in the history, and is shown to its person as it was. Return the task's new subject.

    Raises:
        Problem: ``nothing_to_undo``, ``answer_id_used``, ``answer_changed``, ``answered_too_often``.
    """
    last = subject.last
    if _repeated(session, subject, undone, {"verdict": None}) is None:
        if last is None or last.verdict is None:
            raise conflict("nothing_to_undo", "There is no answer of yours to take back.", "Ask for the task again.")
        reopen(session, subject.person_id, subject.recording_id, subject.apex_id)
        with _counted(session, subject, last.frame_index):
            mark = find_mark(session, subject.person_id, last.sensor_id, last.frame_index, subject.vertex.corner)
            if mark is not None:
                set_standing(session, mark.id, is_mark=False)
            _restore_verdict(session, subject)
            _write(session, subject, undone, {"verdict": None, "u": last.u, "v": last.v}, last, None)
            session.connection().execute(_LEASED_AGAIN, {"task": subject.task_id, "lease_s": lease_s})
    return subjects(session, subject.person_id, task_id=subject.task_id)[0]


def _counted(session: Session, subject: Subject, frame_index: int) -> AbstractContextManager[None]:
    is_first = subject.mark is None and subject.verdict is None
    whose = (subject.person_id, subject.frame.sensor_id, frame_index)
    return counted(session, *whose, subject.vertex.corner, subject.apex_id, is_first=is_first)


def _restore_verdict(session: Session, subject: Subject) -> None:
    """Let the verdict of the person's answer in another camera stand, if there is one; else none."""
    if subject.verdict is None:
        return
    set_standing(session, subject.verdict.id, is_verdict=False)
    own = (
        select(AnswerRow).filter_by(person_id=subject.person_id, apex_id=subject.apex_id).order_by(AnswerRow.version)
    )
    elsewhere = own.where(AnswerRow.sensor_id != subject.frame.sensor_id)
    last = {row.sensor_id: row for row in session.scalars(elsewhere)}
    standing = sorted((row for row in last.values() if row.verdict), key=lambda row: row.created_at)
    if standing:
        set_standing(session, standing[-1].id, is_verdict=True)


def _repeated(session: Session, subject: Subject, answer: Answer | Undo, content: Json) -> AnswerRow | None:
    """Return the earlier answer with this id; None if the id is new and the answer replaces the present version.

    Raises:
        Problem: ``answer_id_used``, ``answer_changed``, ``answered_too_often``.
    """
    if answer.version == own_version(subject):
        if answer.version >= MOST_ANSWERS:
            _check_answer_limit(session, subject)
        return None
    earlier = session.get(AnswerRow, answer.id)
    if earlier is not None:
        whose = {"person_id": subject.person_id, "apex_id": subject.apex_id, "sensor_id": subject.frame.sensor_id}
        if all(getattr(earlier, name) == value for name, value in (whose | content).items()):
            return earlier
        raise _id_used(answer.id)
    own = own_answer(subject)
    raise conflict(
        "answer_changed",
        f"You answered this corner elsewhere meanwhile: {_in_words(own)}. What you send now was made before that.",
        "Decide which of your answers holds; send this one with the version in `own` to replace that one.",
        own=own.model_dump(mode="json"),
    )


def _id_used(id: UUID) -> Problem:
    return conflict(
        "answer_id_used",
        f"The id {id} belongs to another answer.",
        "Make a new random id for each answer; send the same id only with the same answer.",
    )


def _in_words(own: Own) -> str:
    word = own.verdict or "no verdict"
    return f"{word} at ({own.mark.u:g}, {own.mark.v:g})" if own.mark else word


def _check_answer_limit(session: Session, subject: Subject) -> None:
    """Refuse an answer beyond `MOST_ANSWERS`. Undo is refused, too, so that one answer remains."""
    own = {"person_id": subject.person_id, "apex_id": subject.apex_id, "sensor_id": subject.frame.sensor_id}
    if (session.scalar(select(func.count(AnswerRow.verdict)).filter_by(**own)) or 0) >= MOST_ANSWERS:
        raise conflict(
            "answered_too_often",
            f"You have answered this corner {MOST_ANSWERS} times; your last answer stays.",
            "Where it is wrong, ask a reviewer to look at it.",
        )


def _write(
    session: Session,
    subject: Subject,
    answer: Answer | Undo,
    content: Json,
    mark: PriorAnswer | None,
    verdict: PriorAnswer | None,
) -> None:
    whose = {"recording_id": subject.recording_id, "person_id": subject.person_id, "apex_id": subject.apex_id}
    frame = {"sensor_id": subject.frame.sensor_id, "frame_index": subject.frame.frame_index}
    row = {
        "id": answer.id,
        "version": answer.version + 1,
        "corner": subject.vertex.corner,
        "reviewed": bool(subject.is_told),
    }
    if not write_answer(session, row | whose | frame | content, mark, verdict):
        raise _id_used(answer.id)
