"""Marks by the machine, in one camera of a detection."""

from __future__ import annotations

from uuid import UUID

from sqlalchemy import select

from apexcal.documents.camera_models import parse_model
from apexcal.documents.machine_marks import MachineMark, MarksList, MarksRequest
from service.analyses.jobs import analysis_of
from service.annotations.disclosure_actions import DisclosureKey, disclose
from service.crops.queries import marks_of
from service.detections.queries import done_detection
from service.platform.auth.access import Access
from service.platform.db.analyses import Analysis
from service.platform.db.base import Json
from service.platform.db.detections import Detection, Vertex, VertexFrame
from service.platform.db.recordings import Recording
from service.platform.db.session import Database
from service.platform.http.problems import conflict
from service.recordings.queries import find_camera


def plan(access: Access, request: MarksRequest) -> Analysis:
    """The camera, and the model of an unstated lens. Raises :class:`Problem` 404, 409 ``detection_not_done``."""
    detection = done_detection(access, request.detection_id, "engineer")
    recording = access.session.get_one(Recording, detection.recording_id)
    camera = find_camera(access.session, recording.id, request.camera)
    question = {"camera": camera.name, "model": parse_model(request.model)}
    return analysis_of(recording, request.kind, question, detection.id)


def members(row: Analysis) -> Json:
    """The marks in numbers: whoever is told where they are does not mark blindly any more."""
    numbers = {name: value for name, value in row.result.items() if name != "marks"} if row.result else None
    return {"camera": row.asked["camera"], "result": numbers}


def list_marks(access: Access, database: Database, analysis_id: UUID) -> MarksList:
    """The marks of an analysis; what one answers on their vertices afterwards counts as reviewed.

    Raises:
        Problem: 404, 403, 409 ``no_marks``.
    """
    row = access.find(Analysis, analysis_id, "reviewer")
    if row.kind != "machine_marks" or row.result is None:
        raise conflict(
            "no_marks", f"This analysis ({row.kind}) is {row.state}; it has no marks.", "Ask for machine_marks."
        )
    fields = MachineMark.model_fields
    marks = [{name: value for name, value in mark.items() if name in fields} for mark in marks_of(row)]
    answer = MarksList(marks=[MachineMark(**mark) for mark in marks])
    detection = access.session.get_one(Detection, row.detection_id)
    camera = find_camera(access.session, detection.recording_id, row.asked["camera"])
    paired = select(VertexFrame.frame_index, Vertex.sweep_index, Vertex.corner).join(Vertex)
    of_camera = paired.where(Vertex.detection_id == row.detection_id, VertexFrame.sensor_id == camera.id)
    of_camera = of_camera.where(Vertex.corner.in_({mark.corner for mark in answer.marks}))
    disclose(access, database, camera, {DisclosureKey(*key) for key in access.session.execute(of_camera)}, "marks")
    return answer
