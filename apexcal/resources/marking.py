"""Marking: tasks handed out one by one, and what people answered."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from uuid import UUID, uuid4

from apexcal.documents.crops import CropProgress, CropSheet, CropVerdict
from apexcal.documents.marking import AnswerView, GivenMark, MarkView, Progress, Tally, TaskView, VerdictName
from apexcal.transport import Resource, at, read


class Marking(Resource):
    """``client.marking``: what the marking page does, for programs. Pixels: (0, 0) is the top-left pixel's centre."""

    def next_task(
        self, detection_id: UUID | str, camera: str, *, skip: UUID | str | None = None, ahead: int = 0
    ) -> TaskView | None:
        """The next vertex for this person, leased for a while, or None when nothing is left.

        Asked again before it is answered it is the same task, with a new lease; ``skip`` gives that one back.
        ``ahead``: number of further tasks that are leased too, in the task's own ``ahead``.
        """
        body = {"camera": camera} | ({"skip": str(skip)} if skip else {}) | ({"ahead": ahead} if ahead else {})
        answer = self._http.create(at("detections", detection_id, "tasks", "next"), json=body)
        return read(answer, TaskView) if answer.content else None

    def answer(
        self,
        task_id: UUID | str,
        verdict: VerdictName,
        *,
        u: float | None = None,
        v: float | None = None,
        version: int = 0,
        id: UUID | str | None = None,
    ) -> AnswerView:
        """Answer a task; a confirmed vertex needs its mark (pixels).

        ``version``: of the own answer that this one replaces, as the task's ``own`` or the last answer has it.
        ``id``: one's own random id, by which the same answer may be sent again. ApiError ``answer_changed`` where
        this person has answered elsewhere meanwhile.
        """
        mark = None if u is None or v is None else {"u": u, "v": v}
        body = {"id": str(id or uuid4()), "version": version, "verdict": verdict, "mark": mark}
        return self._http.post(at("tasks", task_id, "answer"), AnswerView, body)

    def undo(self, task_id: UUID | str, version: int, *, id: UUID | str | None = None) -> TaskView:
        """Take back the answer of this version; returns the task, which is this person's again."""
        return self._http.post(at("tasks", task_id, "undo"), TaskView, {"id": str(id or uuid4()), "version": version})

    def crop_progress(self, detection_id: UUID | str, camera: str) -> CropProgress:
        """How many marks the machine has, how many people have looked at, and how many blind marks are needed."""
        return self._http.get(at("detections", detection_id, "crops"), CropProgress, camera=camera)

    def next_crops(self, detection_id: UUID | str, camera: str) -> CropSheet | None:
        """A page of the machine's marks to look at, or None when none needs a look. Some are shifted on purpose.

        ApiError ``blind_marks_first``, ``no_marks``, ``too_few_marks``.
        """
        answer = self._http.create(at("detections", detection_id, "crops", "next"), json={"camera": camera})
        return read(answer, CropSheet) if answer.content else None

    def answer_crops(
        self, page_id: UUID | str, wrong: Sequence[UUID | str] = (), *, id: UUID | str | None = None
    ) -> CropVerdict:
        """Accept the marks of a page but those of the vertices ``wrong``.

        ``id``: one's own random id, by which the same answer may be sent again.
        """
        body = {"id": str(id or uuid4()), "wrong": [str(vertex_id) for vertex_id in wrong]}
        return self._http.post(at("crop-pages", page_id, "answer"), CropVerdict, body)

    def own_mark(self, recording_id: UUID | str, camera: str, index: int) -> MarkView:
        """This person's mark in a frame: ``u``, ``v``, ``version``; ApiError ``not_marked`` where there is none."""
        return self._http.get(_mark(recording_id, camera, index), MarkView)

    def put_mark(
        self, recording_id: UUID | str, camera: str, index: int, u: float, v: float, *, version: int | None = None
    ) -> MarkView:
        """Set this person's mark in a frame without an answer; ``version`` is that of the mark that is corrected."""
        condition = {"If-None-Match": "*"} if version is None else {"If-Match": f'"v{version}"'}
        return self._http.put(_mark(recording_id, camera, index), MarkView, {"u": u, "v": v}, condition)

    def progress(self, detection_id: UUID | str, camera: str) -> Progress:
        """How many answers each vertex needs, and how many vertices have them."""
        return self._http.get(at("detections", detection_id, "progress"), Progress, camera=camera)

    def tally(self, detection_id: UUID | str, camera: str) -> Tally:
        """What people said, in numbers; for reviewers. What they answer afterwards counts as reviewed."""
        return self._http.get(at("detections", detection_id, "tally"), Tally, camera=camera)

    def marks(self, detection_id: UUID | str, camera: str) -> Iterator[GivenMark]:
        """This person's answers, and others' on complete vertices; a reviewer's list holds everybody's."""
        return self._http.items(at("detections", detection_id, "marks"), GivenMark, camera=camera)


def _mark(recording_id: UUID | str, camera: str, index: int) -> str:
    return at("recordings", recording_id, "cameras", camera, "frames", index, "mark")
