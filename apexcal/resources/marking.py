"""Marking: tasks handed out one by one, and what people answered."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal
from uuid import UUID, uuid4

from apexcal.transport import Document, Transport, at

Verdict = Literal["confirmed", "rejected", "unsure"]


class Marking:
    """``client.marking``: what the marking page does, for programs. Pixels: (0, 0) is the top-left pixel's centre."""

    def __init__(self, transport: Transport) -> None:
        self._http = transport

    def next_task(self, detection_id: UUID | str, camera: str, *, skip: str | None = None) -> Document | None:
        """The next vertex for this person, leased for a while, or None when nothing is left.

        Asked again before it is answered it is the same task, with a new lease; ``skip`` gives that one back.
        """
        body = {"camera": camera} | ({"skip": skip} if skip else {})
        return self._http.post(at("detections", detection_id, "tasks", "next"), body) or None

    def answer(
        self,
        task_id: str,
        verdict: Verdict,
        *,
        u: float | None = None,
        v: float | None = None,
        version: int = 0,
        id: UUID | str | None = None,
    ) -> Document:
        """Answer a task; a confirmed vertex needs its mark (pixels).

        ``version``: of the own answer that this one replaces, as the task's ``own`` or the last answer has it.
        ``id``: one's own random id, by which the same answer may be sent again. ApiError ``answer_changed`` where
        this person has answered elsewhere meanwhile.
        """
        mark = None if u is None or v is None else {"u": u, "v": v}
        body = {"id": str(id or uuid4()), "version": version, "verdict": verdict, "mark": mark}
        return self._http.post(at("tasks", task_id, "answer"), body)

    def undo(self, task_id: str, version: int, *, id: UUID | str | None = None) -> Document:
        """Take back the answer of this version; returns the task, which is this person's again."""
        return self._http.post(at("tasks", task_id, "undo"), {"id": str(id or uuid4()), "version": version})

    def own_mark(self, recording_id: UUID | str, camera: str, index: int) -> Document:
        """This person's mark in a frame: ``{"u", "v", "version"}``; ApiError ``not_marked`` where there is none."""
        return self._http.get(_mark(recording_id, camera, index))

    def put_mark(
        self, recording_id: UUID | str, camera: str, index: int, u: float, v: float, *, version: int | None = None
    ) -> Document:
        """Set this person's mark in a frame without an answer; ``version`` is that of the mark that is corrected."""
        condition = {"If-None-Match": "*"} if version is None else {"If-Match": f'"v{version}"'}
        return self._http.put(_mark(recording_id, camera, index), {"u": u, "v": v}, condition)

    def progress(self, detection_id: UUID | str, camera: str) -> Document:
        """How many answers each vertex needs, and how many vertices have them."""
        return self._http.get(at("detections", detection_id, "progress"), camera=camera)

    def tally(self, detection_id: UUID | str, camera: str) -> Document:
        """What people said, in numbers; for reviewers. What they answer afterwards counts as reviewed."""
        return self._http.get(at("detections", detection_id, "tally"), camera=camera)

    def marks(self, detection_id: UUID | str, camera: str) -> Iterator[Document]:
        """This person's answers, and others' on complete vertices; a reviewer's list holds everybody's."""
        return self._http.items(at("detections", detection_id, "marks"), camera=camera)


def _mark(recording_id: UUID | str, camera: str, index: int) -> str:
    return at("recordings", recording_id, "cameras", camera, "frames", index, "mark")
