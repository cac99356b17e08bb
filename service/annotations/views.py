"""Views of tasks, marks and answers."""

from __future__ import annotations

from typing import NamedTuple
from urllib.parse import quote
from uuid import UUID

from sqlalchemy import and_, select
from sqlalchemy.orm import Session

from apexcal.documents.detections import Moved, VertexSummary
from apexcal.documents.marking import MarkView, Own, Pixel, TaskFrame, TaskView
from service.annotations.mark_actions import find_mark, find_verdict
from service.auth.access import Access
from service.db.annotations import Answer, Mark, MarkingTask
from service.db.detections import Detection, Vertex, VertexFrame
from service.db.recordings import CameraFrame, Sensor
from service.http.problems import not_found


class PairedFrame(NamedTuple):
    """A vertex together with its frame in one camera, and how they are paired."""

    vertex: Vertex
    camera: Sensor
    frame: CameraFrame
    pairing: VertexFrame


def find_task(access: Access, task_id: UUID) -> tuple[MarkingTask, Detection]:
    """A person's own task and its detection. Another person's tasks do not exist for them."""
    task = access.session.get(MarkingTask, task_id)
    if task is None or task.person_id != access.person.id:
        raise not_found()
    return task, access.find(Detection, task.detection_id, "annotator")


def find_frame(session: Session, vertex_id: UUID, sensor_id: UUID) -> PairedFrame:
    """The frame that a vertex is paired with in a camera."""
    row = session.execute(
        select(Vertex, Sensor, CameraFrame, VertexFrame)
        .join(VertexFrame, VertexFrame.vertex_id == Vertex.id)
        .join(Sensor, Sensor.id == VertexFrame.sensor_id)
        .join(
            CameraFrame,
            and_(CameraFrame.sensor_id == VertexFrame.sensor_id, CameraFrame.index == VertexFrame.frame_index),
        )
        .where(Vertex.id == vertex_id, VertexFrame.sensor_id == sensor_id)
    ).one()
    return PairedFrame(*row)


def mark_view(mark: Mark | None) -> MarkView | None:
    """A mark's public members."""
    return MarkView(u=mark.u, v=mark.v, version=mark.version) if mark else None


def task_view(session: Session, task: MarkingTask) -> TaskView:
    """A task with all that is needed to judge it, and nothing of what others said."""
    found = find_frame(session, task.vertex_id, task.sensor_id)
    vertex, camera, frame, pairing = found
    return TaskView(
        task_id=task.id,
        person_id=task.person_id,
        leased_until=task.leased_until,
        vertex=VertexSummary.model_validate(vertex, from_attributes=True),
        camera=camera.name,
        frame=TaskFrame(
            index=frame.index,
            stamp_ns=frame.stamp_ns,
            width=frame.width,
            height=frame.height,
            url=f"/v1/recordings/{camera.recording_id}/cameras/{quote(camera.name, safe='')}/frames/{frame.index}",
        ),
        gap_ns=pairing.gap_ns,
        moved=Moved.model_validate(pairing) if pairing.x is not None else None,
        predicted=None,
        own=own_answer(session, task.person_id, found),
    )


def last_answer(session: Session, person_id: UUID, apex_id: UUID, sensor_id: UUID) -> Answer | None:
    """The last that a person said of an apex in a camera, or that they took it back."""
    return session.scalar(
        select(Answer)
        .where(Answer.person_id == person_id, Answer.apex_id == apex_id, Answer.sensor_id == sensor_id)
        .order_by(Answer.version.desc())
        .limit(1)
    )


def own_answer(session: Session, person_id: UUID, found: PairedFrame) -> Own:
    """What a person says of a vertex, and where they marked it; also the mark of an answer that they took back."""
    last = last_answer(session, person_id, found.vertex.apex_id, found.camera.id)
    mark: Mark | Answer | None = find_mark(session, person_id, found.camera.id, found.frame.index)
    if mark is None and last is not None and last.frame_index == found.frame.index:
        mark = last
    # Without a version: an answer from before versions, or the verdict of an answer in another camera.
    said = last or find_verdict(session, person_id, found.vertex.apex_id)
    u, v = (mark.u, mark.v) if mark else (None, None)
    return Own(
        version=last.version if last else 0,
        mark=None if u is None or v is None else Pixel(u=u, v=v),
        verdict=said.verdict if said else None,  # pyright: ignore[reportArgumentType] - only verdicts
    )
