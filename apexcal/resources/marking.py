"""Marking: tasks handed out one by one, and what people answered."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal
from uuid import UUID

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

    def answer(self, task_id: str, verdict: Verdict, *, u: float | None = None, v: float | None = None) -> Document:
        """Answer a task; a confirmed vertex needs its mark (pixels)."""
        mark = None if u is None or v is None else {"u": u, "v": v}
        return self._http.post(at("tasks", task_id, "answer"), {"verdict": verdict, "mark": mark})

    def own_mark(self, recording_id: UUID | str, camera: str, index: int) -> Document:
        """This person's mark in a frame: ``{"u", "v", "version"}``; ApiError ``not_marked`` where there is none."""
        return self._http.get(_mark(recording_id, camera, index))

    def put_mark(
        self, recording_id: UUID | str, camera: str, index: int, u: float, v: float, *, version: int | None = None
    ) -> Document:
        """Set this person's mark in a frame; ``version`` is that of the mark that is corrected, None for a first."""
        condition = {"If-None-Match": "*"} if version is None else {"If-Match": f'"v{version}"'}
        return self._http.put(_mark(recording_id, camera, index), {"u": u, "v": v}, condition)

    def delete_mark(self, recording_id: UUID | str, camera: str, index: int) -> None:
        """Take this person's mark back; the vertex takes an answer again."""
        self._http.delete(_mark(recording_id, camera, index))

    def put_verdict(self, vertex_id: UUID | str, verdict: Verdict) -> Document:
        """Set this person's verdict on a vertex."""
        return self._http.put(at("vertices", vertex_id, "verdict"), {"verdict": verdict})

    def delete_verdict(self, vertex_id: UUID | str) -> None:
        """Take this person's verdict back; the vertex takes an answer again."""
        self._http.delete(at("vertices", vertex_id, "verdict"))

    def progress(self, detection_id: UUID | str, camera: str) -> Document:
        """How many marks are wanted, and how many are there."""
        return self._http.get(at("detections", detection_id, "progress"), camera=camera)

    def marks(self, detection_id: UUID | str, camera: str) -> Iterator[Document]:
        """This person's marks; a reviewer's answer holds everybody's."""
        return self._http.items(at("detections", detection_id, "marks"), camera=camera)


def _mark(recording_id: UUID | str, camera: str, index: int) -> str:
    return at("recordings", recording_id, "cameras", camera, "frames", index, "mark")
