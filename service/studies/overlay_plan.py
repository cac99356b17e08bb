"""What an overlay is drawn from: a result's lens and mount, a frame, and the track of the board."""

from __future__ import annotations

from uuid import UUID

from sqlalchemy import select

from apexcal.documents.overlays import OverlayRequest
from apexcal.documents.states import WorkState
from service.detections.queries import find_camera, ready_recording
from service.platform.auth.access import Access
from service.platform.db.base import Json
from service.platform.db.calibrations import Calibration, CalibrationRun, CorrespondenceSet, Result
from service.platform.db.detections import Detection
from service.platform.db.recordings import CameraFrame, Recording
from service.platform.http.problems import Problem, not_found


def plan_overlay(access: Access, result: Result, wanted: OverlayRequest) -> tuple[Recording, Json]:
    """The recording, and plain data for the worker.

    Raises:
        Problem: 404 ``unknown_camera``, ``no_such_frame``; 409 ``recording_not_ready``; 422 ``no_recording``,
            ``recording_of_another_rig``, ``image_size_differs``.
    """
    session = access.session
    pairs = pairs_of(access, result)
    recording_id = wanted.recording_id or pairs.recording_id
    if recording_id is None:
        raise Problem(
            422,
            "no_recording",
            "The result's pairs were imported, so no recording belongs to them.",
            "Name a recording of the result's rig as `recording_id`.",
        )
    recording = ready_recording(access, recording_id, "reviewer")
    if recording.rig_id != session.get_one(Calibration, result.calibration_id).rig_id:
        raise Problem(
            422,
            "recording_of_another_rig",
            f"The recording {recording.name!r} was made with another rig than the result is of.",
            "Name a recording of the result's rig.",
        )
    _check_frame(access, recording, result, wanted.frame)
    detection_id, offset_ns = _track(access, recording, pairs)
    lens, transform = result.document["intrinsics"], result.document["transform"]
    return recording, {
        "result_id": str(result.id),
        "camera": result.camera,
        "frame": wanted.frame,
        "intrinsics": lens,
        "transform": transform,
        "detection_id": str(detection_id) if detection_id else None,
        "offset_ns": offset_ns,
    }


def pairs_of(access: Access, result: Result) -> CorrespondenceSet:
    """The pairs that a result was fitted to. Raises :class:`Problem` 404."""
    found = access.session.scalars(
        select(CorrespondenceSet)
        .join(CalibrationRun, CalibrationRun.set_id == CorrespondenceSet.id)
        .where(CalibrationRun.id == result.run_id)
    ).one_or_none()
    if found is None:
        # Deleted at this moment.
        raise not_found()
    return found


def _check_frame(access: Access, recording: Recording, result: Result, index: int) -> None:
    camera = find_camera(access.session, recording.id, result.camera)
    frame = access.session.get(CameraFrame, (camera.id, index))
    if frame is None:
        raise Problem(
            404, "no_such_frame", f"{camera.name} has no frame {index}.", f"It has {camera.count}, numbered from 0."
        )
    width, height = result.fit.intrinsics.image_size
    if (width, height) != (frame.width, frame.height):
        raise Problem(
            422,
            "image_size_differs",
            f"The result is of images of {width} x {height} px, and the frame has {frame.width} x {frame.height}.",
            "Name a frame of the size that was calibrated.",
        )


def _track(access: Access, recording: Recording, pairs: CorrespondenceSet) -> tuple[UUID | None, int]:
    """The detection that has the board's track, if there is one, and the camera's clock minus the LiDAR's in ns.

    Of the detection that the pairs are of, else of the recording's newest one, as the pages do.
    """
    session = access.session
    if recording.id == pairs.recording_id and pairs.detection_id is not None:
        detection = session.get_one(Detection, pairs.detection_id)
        return detection.id, detection.pairing.get("offset_ns") or 0
    newest = (
        select(Detection.id)
        .where(Detection.recording_id == recording.id, Detection.state == WorkState.DONE)
        .order_by(Detection.id.desc())
        .limit(1)
    )
    return session.scalar(newest), 0
