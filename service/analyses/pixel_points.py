"""Points in 3D that pixels show."""

from __future__ import annotations

from uuid import UUID

from sqlalchemy import select
from sqlalchemy.orm import Session

from apexcal.documents.pixel_points import PixelPointsRequest
from service.analyses.validations import plan_on_recording
from service.platform.auth.access import Access
from service.platform.db.analyses import Analysis
from service.platform.db.calibrations import CalibrationRun, CorrespondenceSet, Result
from service.platform.db.detections import Detection
from service.platform.db.recordings import CameraFrame
from service.platform.http.problems import not_found
from service.recordings.queries import find_camera

_ASKED = {"frame", "stamp_ns", "pixels", "k", "lidar_noise"}


def plan(access: Access, request: PixelPointsRequest) -> Analysis:
    """Make the row of a question: pixels, their moment and the calibration.

    Raises:
        Problem: as ``plan_on_recording``, and 404 ``unknown_frame``.
    """
    row = plan_on_recording(access, request)
    _check_frame(access.session, request)
    offset_ns = request.clock_offset_ns
    if offset_ns is None:
        offset_ns = _pairing_offset_ns(access.session, row.result_id) if row.result_id else 0
    row.asked = row.asked | request.model_dump(include=_ASKED) | {"clock_offset_ns": offset_ns}
    return row


def _check_frame(session: Session, request: PixelPointsRequest) -> None:
    camera = find_camera(session, request.recording_id, request.camera)
    if request.frame is not None and session.get(CameraFrame, (camera.id, request.frame)) is None:
        raise not_found(
            "unknown_frame",
            f"The camera {camera.name!r} has no frame {request.frame} in this recording.",
            f"Its {camera.count} frames are numbered from 0; or give `stamp_ns`.",
        )


def _pairing_offset_ns(session: Session, result_id: UUID) -> int:
    """The clocks' offset under which a result's pairs were made; 0 if they name none."""
    pairing = session.scalar(
        select(Detection.pairing)
        .join(CorrespondenceSet, CorrespondenceSet.detection_id == Detection.id)
        .join(CalibrationRun, CalibrationRun.set_id == CorrespondenceSet.id)
        .join(Result, Result.run_id == CalibrationRun.id)
        .where(Result.id == result_id)
    )
    return int((pairing or {}).get("offset_ns", 0))
