"""Giving and undoing an answer: once per id, on the version that the person saw, ten times at most.

The person's lock is held, so that two browser tabs of one person come one after the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from uuid import UUID

from sqlalchemy import select
from sqlalchemy.orm import Session

from apexcal.documents.marking import Answer, AnswerView, Own, Pixel, Undo
from service.annotations.mark_actions import check_inside, find_mark, take_back, write_mark, write_verdict
from service.annotations.progress_actions import counted
from service.annotations.task_actions import reopen
from service.annotations.views import Subject, own_answer, own_answers, subjects
from service.db.annotations import Answer as AnswerRow
from service.db.clock import now
from service.http.problems import Problem

# People correct themselves once or twice. Each answer stays in the history, so their number is bounded: this many
# rows, and as many for taking them back.
MOST_ANSWERS = 10


def give(session: Session, found: Subject, said: Answer) -> AnswerRow:
    """Write mark and verdict of a task's vertex. The same id again changes nothing and gives the same row.

    An answer counts also when its lease ran out, and when the vertex has as many answers as wanted already.

    Raises:
        Problem: ``mark_required``, ``mark_outside_image``, ``answer_id_used``, ``answer_changed``,
            ``answered_too_often``.
    """
    verdict, mark = said.verdict, said.mark if said.verdict == "confirmed" else None
    if verdict == "confirmed" and mark is None:
        raise Problem(
            422, "mark_required", "A confirmed vertex needs its mark.", 'Send "mark": {"u": ..., "v": ...} in pixels.'
        )
    if mark is not None:
        check_inside(mark.u, mark.v, found.frame)
    answers = own_answers(session, found, [found.vertex.apex_id], said.id)
    repeated = _repeated(answers, found, said.id, verdict, mark)
    if repeated is not None:
        return repeated
    last = _check_version(answers, found, said.version)
    _check_patience(answers)
    camera, person_id, apex_id = found.camera, found.task.person_id, found.vertex.apex_id
    if found.verdict is not None and found.verdict.verdict != verdict:
        reopen(session, camera.recording_id)
    with _counted(session, found, found.frame.index):
        row = _new(session, found, said.id, (last.version if last else 0) + 1)
        row.verdict = verdict
        if mark is not None:
            row.u, row.v = mark.u, mark.v
            at = {"corner": found.vertex.corner, "reviewed": row.reviewed}
            write_mark(session, found.mark, person_id, camera, found.frame, mark.u, mark.v, **at)
        whose = (person_id, camera.recording_id, apex_id)
        write_verdict(session, found.verdict, *whose, verdict, reviewed=row.reviewed)
        found.task.answered_at = now()  # pyright: ignore[reportAttributeAccessIssue] - the database's own clock
    return row


def undo(session: Session, found: Subject, said: Undo, lease_s: float) -> list[Subject]:
    """Take the last answer back, and lease its vertex to the same person again in the same transaction.

    The mark stays in the history, and is shown to its person as it was. Returns what the task asks now.

    Raises:
        Problem: ``nothing_to_undo``, ``answer_id_used``, ``answer_changed``, ``answered_too_often``.
    """
    answers = own_answers(session, found, [found.vertex.apex_id], said.id)
    if _repeated(answers, found, said.id, None, None) is None:
        last = _check_version(answers, found, said.version)
        if last is None or last.verdict is None:
            raise Problem(
                409, "nothing_to_undo", "There is no answer of yours to take back.", "Ask for the task again."
            )
        _check_patience(answers)
        reopen(session, found.camera.recording_id)
        with _counted(session, found, last.frame_index):
            row = _new(session, found, said.id, last.version + 1)
            row.u, row.v = last.u, last.v
            mark = find_mark(session, found.task.person_id, found.camera.id, last.frame_index, found.vertex.corner)
            if mark is not None:
                take_back(session, mark)
            _restore_verdict(session, found)
            found.task.answered_at = None
            found.task.leased_until = now(lease_s)  # pyright: ignore[reportAttributeAccessIssue] - the database's own clock
    return subjects(session, found.task.person_id, task_id=found.task.id)


def answer_view(row: AnswerRow) -> AnswerView:
    """An answer that was accepted."""
    mark = None if row.u is None or row.v is None else Pixel(u=row.u, v=row.v)
    return AnswerView(id=row.id, version=row.version, verdict=row.verdict, mark=mark, reviewed=row.reviewed)  # pyright: ignore[reportArgumentType] - only verdicts


def _counted(session: Session, found: Subject, frame_index: int) -> AbstractContextManager[None]:
    vertex = found.vertex
    is_first = found.mark is None and found.verdict is None
    whose = (found.task.person_id, found.camera.id, frame_index)
    return counted(session, *whose, vertex.corner, vertex.apex_id, is_first=is_first)


def _restore_verdict(session: Session, found: Subject) -> None:
    """The verdict as the person's answer in another camera has it, if there is one; else it is taken back."""
    if found.verdict is None:
        return
    person_id, apex_id = found.task.person_id, found.vertex.apex_id
    own = select(AnswerRow).filter_by(person_id=person_id, apex_id=apex_id).order_by(AnswerRow.version)
    last = {row.sensor_id: row for row in session.scalars(own.where(AnswerRow.sensor_id != found.camera.id))}
    standing = sorted((row for row in last.values() if row.verdict), key=lambda row: row.created_at)
    if standing:
        kept, whose = standing[-1], (person_id, found.camera.recording_id, apex_id)
        write_verdict(session, found.verdict, *whose, kept.verdict or "", reviewed=kept.reviewed)
    else:
        take_back(session, found.verdict)


def _repeated(
    answers: Sequence[AnswerRow], found: Subject, id: UUID, verdict: str | None, mark: Pixel | None
) -> AnswerRow | None:
    known = next((row for row in answers if row.id == id), None)
    if known is None:
        return None
    subject = (found.task.person_id, found.vertex.apex_id, found.camera.id, verdict)
    same_mark = verdict is None or (known.u, known.v) == ((mark.u, mark.v) if mark else (None, None))
    if (known.person_id, known.apex_id, known.sensor_id, known.verdict) == subject and same_mark:
        return known
    raise Problem(
        409,
        "answer_id_used",
        f"The id {id} belongs to another answer.",
        "Make a new random id for each answer; send the same id only with the same answer.",
    )


def _check_version(answers: Sequence[AnswerRow], found: Subject, version: int) -> AnswerRow | None:
    last = answers[-1] if answers else None
    if version == (last.version if last else 0):
        return last
    own = own_answer(found, last)
    raise Problem(
        409,
        "answer_changed",
        f"You answered this vertex elsewhere meanwhile: {_in_words(own)}. What you send now was made before that.",
        "Decide which of your answers holds; send this one with the version in `own` to replace that one.",
        own=own.model_dump(mode="json"),
    )


def _in_words(own: Own) -> str:
    if own.verdict is None:
        return "you took the answer back"
    return f"{own.verdict} at ({own.mark.u:g}, {own.mark.v:g})" if own.mark else own.verdict


def _check_patience(answers: Sequence[AnswerRow]) -> None:
    """Refuse more answers; also to take the last one back, which would leave none."""
    if sum(row.verdict is not None for row in answers) >= MOST_ANSWERS:
        raise Problem(
            409,
            "answered_too_often",
            f"You have answered this vertex {MOST_ANSWERS} times; your last answer stays.",
            "Where it is wrong, ask a reviewer to look at it.",
        )


def _new(session: Session, found: Subject, id: UUID, version: int) -> AnswerRow:
    whose = {"recording_id": found.camera.recording_id, "person_id": found.task.person_id}
    subject = {"apex_id": found.vertex.apex_id, "sensor_id": found.camera.id, "frame_index": found.frame.index}
    row = AnswerRow(id=id, version=version, reviewed=found.told, **whose, **subject)
    session.add(row)
    return row
