"""Requests and answers about tasks, marks and verdicts."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Literal
from uuid import UUID

from pydantic import Field, FiniteFloat

from apexcal.documents.base import Received, Sent
from apexcal.documents.corners import TOP, CornerName
from apexcal.documents.detections import Moved, VertexSummary

VerdictName = Literal["confirmed", "rejected", "unsure"]
Version = Annotated[int, Field(ge=0, le=2**31 - 1)]
CameraName = Annotated[str, Field(max_length=200, description="a camera's name in the rig")]


class Pixel(Received):
    """A place in an image: u to the right, v down, (0, 0) is the centre of the top-left pixel."""

    u: FiniteFloat
    v: FiniteFloat


class NextTask(Received):
    """Ask for a vertex to judge; ``skip`` gives a held task back and moves on.

    ``ahead``: number of further leases, so that the next tasks can be shown before this answer has arrived, also
    without a network. Beyond five, a person gets half of their share of what is open.
    ``vertex_id``: this vertex comes first, also if it has all the answers asked for.
    """

    camera: CameraName
    skip: UUID | None = None
    vertex_id: UUID | None = None
    ahead: int = Field(default=0, ge=0, le=50)


class Answer(Received):
    """A verdict, and with ``confirmed`` the place of the vertex. With another verdict a mark is not kept.

    ``id`` is a random one of the client's: the same answer sent again is the same. ``version`` is that of the own
    answer that this one replaces, as the task has it; 0 for a first.
    """

    id: UUID
    version: Version
    verdict: VerdictName
    mark: Pixel | None = None


class Undo(Received):
    """Take the answer of this ``version`` back. ``id`` as for an answer."""

    id: UUID
    version: Version


class MarkView(Sent):
    """A person's own mark."""

    u: float
    v: float
    version: int


class TaskFrame(Sent):
    """The camera frame to look at."""

    index: int
    stamp_ns: int
    width: int
    height: int
    url: str


class Own(Sent):
    """This person's earlier answer on the vertex: its ``version``, or 0. One taken back has a mark and no verdict."""

    version: int
    mark: Pixel | None
    verdict: VerdictName | None


class TaskView(Sent):
    """A vertex and its frame, leased to the person ``person_id`` until ``leased_until``.

    ``moved``: where the vertex was at the frame's time, if the pairing moved it along its track.
    ``ahead``: those that come after it, where they were asked for.
    """

    task_id: UUID
    person_id: UUID
    leased_until: datetime
    vertex: VertexSummary
    camera: str
    frame: TaskFrame
    gap_ns: int
    moved: Moved | None = None
    own: Own
    ahead: list[TaskView] = Field(default_factory=list["TaskView"])


class Progress(Sent):
    """Progress of a detection's marking in one camera. It says nothing of what anybody answered.

    ``vertices`` have a frame of the camera; ``answered`` of them have at least one answer, ``complete`` of them as
    many as wanted (``marks_wanted`` people), ``mine`` of them the asker's. An answer is one by hand, or a confirmed
    mark of the machine. ``by_machine`` of the answered have no answer by hand.
    """

    vertices: int
    marks_wanted: int
    answered: int
    by_machine: int
    mine: int
    complete: int


class MarkingWork(Sent):
    """A camera of a recording in which corners wait for the asker.

    ``waiting`` corners wait; ``mine`` has the asker answered. ``to_confirm`` of the machine's marks wait for a look.
    """

    recording: str
    recording_id: UUID
    detection_id: UUID
    camera: str
    waiting: int
    to_confirm: int
    mine: int


class AnsweredSweeps(Sent):
    """Sweeps with an answered vertex, in one camera: ``sweeps`` of anybody, ``mine`` of the asker."""

    sweeps: list[int]
    mine: list[int]


class PersonAnswers(Sent):
    """Counts of a detection's vertices that somebody has answered."""

    name: str
    answers: int


class Tally(Sent):
    """Counts of people's answers: ``answers`` (people times vertices) and its parts; ``marks`` are those by hand.

    ``reviewed`` of the answers were given after something of others' answers had been told to their person.
    """

    answers: int
    confirmed: int
    rejected: int
    unsure: int
    marks: int
    reviewed: int
    people: list[PersonAnswers]


class AnswerView(Sent):
    """The stored answer, and nothing of others'.

    ``progress`` counts the answer too; null where ``GET /v1/detections/{id}/progress`` has to count all anew.
    """

    id: UUID
    version: int
    verdict: VerdictName
    mark: Pixel | None
    reviewed: bool
    progress: Progress | None


class GivenMark(Sent):
    """An answer on a vertex, as far as the asker may see it.

    ``told_at`` is when something of others' answers on the vertex was first told to this person. ``reviewed``: what
    they say now they said after that, so it is no independent answer. ``is_machine``: they confirmed the machine's
    mark, whose pixel is for reviewers.
    """

    vertex_id: UUID
    person: str
    own: bool
    verdict: VerdictName
    frame_index: int
    mark: MarkView | None
    reviewed: bool
    told_at: datetime | None
    is_machine: bool
    corner: CornerName = TOP
