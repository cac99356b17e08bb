"""What requests and answers about tasks, marks and verdicts look like."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Literal
from uuid import UUID

from pydantic import Field, FiniteFloat

from service.detections.schemas import Flag, Quality
from service.http.schemas import Received, Sent

VerdictName = Literal["confirmed", "rejected", "unsure"]
CameraName = Annotated[str, Field(max_length=200, description="a camera's name in the rig")]


class Pixel(Received):
    """A place in an image: u to the right, v down, (0, 0) is the centre of the top-left pixel."""

    u: FiniteFloat
    v: FiniteFloat


class NextTask(Received):
    """Ask for a vertex to judge; ``skip`` gives a held task back and moves on."""

    camera: CameraName
    skip: UUID | None = None


class Answer(Received):
    """A verdict, and with ``confirmed`` the place of the vertex. With another verdict a mark is not kept."""

    verdict: VerdictName
    mark: Pixel | None = None


class VerdictBody(Received):
    """A verdict on a vertex."""

    verdict: VerdictName


class MarkView(Sent):
    """A person's own mark."""

    u: float
    v: float
    version: int


class VerdictView(Sent):
    """A person's own verdict on a vertex."""

    vertex_id: UUID
    verdict: VerdictName
    version: int


class TaskVertex(Sent):
    """A vertex in metres in the LiDAR frame, and what its detector says that one should look at."""

    id: UUID
    sweep_index: int
    time_ns: int
    x: float
    y: float
    z: float
    ring: int
    points: int
    quality: Quality | None
    flags: list[Flag]


class TaskFrame(Sent):
    """The camera frame to look at."""

    index: int
    stamp_ns: int
    width: int
    height: int
    url: str


class Own(Sent):
    """What this person said of the vertex before."""

    mark: MarkView | None
    verdict: VerdictName | None


class TaskView(Sent):
    """A vertex and its frame, leased to one person until ``leased_until``."""

    task_id: UUID
    leased_until: datetime
    vertex: TaskVertex
    camera: str
    frame: TaskFrame
    gap_ns: int
    predicted: Pixel | None
    own: Own


class PersonAnswers(Sent):
    """How many of a detection's vertices somebody has answered."""

    name: str
    answers: int


class Progress(Sent):
    """How far the marking of a detection is, in one camera.

    ``vertices`` have a frame of the camera; ``answered`` of them have at least one answer, ``complete`` of them as
    many as wanted (``marks_wanted`` people), ``mine`` of them the asker's. ``answers`` counts all answers (people
    times vertices), of which ``confirmed``, ``rejected`` and ``unsure`` are the parts; ``marks`` those with a mark.
    """

    vertices: int
    marks_wanted: int
    answered: int
    answers: int
    mine: int
    complete: int
    confirmed: int
    rejected: int
    unsure: int
    marks: int
    people: list[PersonAnswers]


class AnswerView(Sent):
    """What was kept of an answer, and what others, who were not to be seen before, marked."""

    mark: MarkView | None
    verdict: VerdictName
    progress: Progress
    others: list[Pixel]


class GivenMark(Sent):
    """An answer on a vertex, as far as the asker may see it."""

    vertex_id: UUID
    person: str
    own: bool
    verdict: VerdictName
    frame_index: int
    mark: MarkView | None
