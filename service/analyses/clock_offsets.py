"""Clock offsets: estimated from the agreed marks and the camera's rough mount, with a hint how to use them."""

from __future__ import annotations

from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from apexcal.documents.analyses import OffsetRequest
from apexcal.documents.camera_models import parse_model
from apexcal.documents.corners import TOP
from apexcal.documents.schedules import PRESETS
from service.analyses.jobs import analysis_of
from service.annotations.consensus import agree, far_apart_px
from service.annotations.tally_queries import opinions_of
from service.calibrations.resolve import camera_request
from service.calibrations.work_rules import check_job
from service.detections.queries import done_detection
from service.fleets.rigs import rig_camera
from service.platform.auth.access import Access
from service.platform.db.analyses import Analysis
from service.platform.db.base import Json
from service.platform.db.detections import Detection, Vertex, VertexFrame
from service.platform.db.fleets import Rig
from service.platform.db.recordings import CameraFrame, Recording, Sensor
from service.platform.http.problems import conflict
from service.platform.jobs.bundles import run_cost
from service.recordings.queries import find_camera

# Microseconds a mark of the fits of camera and clock together: 980-1,500 measured, where none needs many steps.
_MARK_US = 2500.0
# Standard deviations within which an offset is no reason to move anything.
_CERTAIN = 2.0


def plan(access: Access, request: OffsetRequest) -> Analysis:
    """The camera and its marks. Raises :class:`Problem` 404, 409 ``nothing_marked``, 422 ``work_too_long``."""
    detection = done_detection(access, request.detection_id, "engineer")
    recording = access.session.get_one(Recording, detection.recording_id)
    camera = find_camera(access.session, recording.id, request.camera)
    question = _camera_and_marks(access.session, recording, detection, camera, request.model)
    return analysis_of(recording, request.kind, question, detection.id)


def members(row: Analysis) -> Json:
    """Return the answer's members besides those of every analysis."""
    camera, marks = row.asked["camera"], len(row.asked["marks"]["u"])
    return {"camera": camera, "marks": marks, "hint": _how_to_use(row.result, camera) if row.result else None}


def _camera_and_marks(
    session: Session, recording: Recording, detection: Detection, camera: Sensor, model: str
) -> Json:
    """The camera as its rig describes it, and every mark that people agree on with its frame's own stamp.

    Which vertex a frame was paired with does not matter: the estimate looks up where the board's tip was.

    Raises:
        Problem: 409 ``nothing_marked``, 422 ``work_too_long``.
        DocumentError: ``unknown_model``.
    """
    opinions = opinions_of(session, detection.id, camera.id)
    stamps = session.execute(
        select(VertexFrame.vertex_id, CameraFrame.stamp_ns)
        .join(Vertex, Vertex.id == VertexFrame.vertex_id)
        .join(
            CameraFrame,
            (CameraFrame.sensor_id == VertexFrame.sensor_id) & (CameraFrame.index == VertexFrame.frame_index),
        )
        .where(Vertex.detection_id == detection.id, Vertex.corner == TOP, VertexFrame.sensor_id == camera.id)
        .order_by(CameraFrame.stamp_ns, Vertex.id)
    )
    of_rig = rig_camera(session, session.get_one(Rig, recording.rig_id), camera.name)
    apart_px = far_apart_px(of_rig.image_width, of_rig.image_height)
    agreed = [(stamp_ns, agree(opinions.get(vertex_id, []), apart_px).pixel) for vertex_id, stamp_ns in stamps]
    marks = [(stamp_ns, *pixel) for stamp_ns, pixel in agreed if pixel]
    if not marks:
        raise conflict(
            "nothing_marked",
            f"No corner of camera {camera.name} is marked yet ({len(agreed)} have a frame).",
            "The offset is found from marks: mark corners first, at least some dozens over the whole recording.",
        )
    # At worst it searches as a calibration does, and polishes.
    searching = run_cost(parse_model(model), len(marks), PRESETS["default"].schedule)
    seconds = searching.seconds + 1e-6 * _MARK_US * len(marks)
    check_job(f"an offset from {len(marks):,} marks", seconds, "Detect in a shorter part of the recording.")
    columns = zip(("stamp_ns", "u", "v"), zip(*marks, strict=True), strict=True)
    return {
        "camera": camera.name,
        "fit_request": camera_request(of_rig, parse_model(model)).model_dump(mode="json"),
        "marks": {name: list(column) for name, column in columns},
    }


def _how_to_use(result: dict[str, Any], camera: str) -> str:
    offset, sigma = result["offset_ns"] / 1e6, result["sigma_ns"] / 1e6
    shows = (
        f"The camera's clock is {abs(offset):.1f} ms {'ahead of' if offset >= 0 else 'behind'} the LiDAR's, "
        f"with a standard deviation of {sigma:.1f} ms"
    )
    if abs(offset) < _CERTAIN * sigma:
        return f"{shows}: the clocks agree within the error, and pairing.offset_ns = 0 will do."
    return (
        f"{shows}. Detect again with pairing.offset_ns = {result['offset_ns']}; "
        'pairing.mode = "interpolate" then moves each corner to the time of its frame. Marks are kept. '
        f"The offset of {camera} is applied to every camera: where their clocks differ, make a detection for each."
    )
