"""Asking for a detection, and for marks of other corners than the tip."""

from __future__ import annotations

from collections.abc import Sequence
from uuid import UUID

from sqlalchemy import delete, select
from sqlalchemy.orm import Session

from apexcal.documents.corners import CORNERS, TOP, CornerName
from apexcal.documents.detections import DetectionRequest
from apexcal.documents.detectors import resolve_options
from service.platform.db.annotations import MarkingFrontier, MarkingProgress
from service.platform.db.base import content_hash
from service.platform.db.detections import Detection, Vertex
from service.platform.db.fleets import Rig
from service.platform.db.recordings import Recording, Sensor
from service.platform.http.problems import conflict

_UP = ("up_x", "up_y", "up_z")


def new_detection(
    recording: Recording, lidar: Sensor, rig: Rig, body: DetectionRequest, person_id: UUID
) -> Detection:
    """The row of a detection, all its options resolved. Raises DocumentError as ``resolve_options`` does.

    Up is as the request says, else as the rig's ``T_vehicle_lidar`` does: the vehicle's z.
    """
    options = resolve_options(body.detector, body.options)
    if rig.lidar.T_vehicle_lidar is not None and all(options.get(name) == 0.0 for name in _UP):
        # Imported here: it needs NumPy, which takes a twentieth of the service's start.
        from apexcal.geometry.se3 import from_document

        up = from_document(rig.lidar.T_vehicle_lidar).R[2].round(6).tolist()
        options |= dict(zip(_UP, up, strict=True))
    pairing = body.pairing.model_dump()
    content = {"region": body.region, "detector": body.detector, "options": options, "pairing": pairing}
    return Detection(
        fleet_id=recording.fleet_id,
        recording_id=recording.id,
        lidar_id=lidar.id,
        **content,
        content_hash=content_hash({"recording": recording.sha256 or recording.id.hex, **content}),
        created_by=person_id,
    )


def ask_corners(session: Session, detection: Detection, corners: Sequence[CornerName]) -> None:
    """Have these corners of a finished detection's vertices marked, and no others. What was marked stays.

    Raises:
        Problem: 409 ``corners_not_known``, no vertex states one of them.
    """
    # The lock: nobody may be given a task meanwhile.
    lock = select(Recording.id).where(Recording.id == detection.recording_id).with_for_update(key_share=True)
    session.execute(lock)
    stated = {TOP, *session.scalars(select(Vertex.corner).where(Vertex.detection_id == detection.id).distinct())}
    for corner in corners:
        if corner not in stated:
            raise conflict(
                "corners_not_known",
                f"No sweep of this detection states the board's {corner} corner.",
                "Detect again with the detector refined and the board's measured size (options board_width_m and "
                "board_height_m).",
                corner=corner,
            )
    detection.marked_corners = [name for name in CORNERS if name in corners]
    # Whoever had no vertex left may have one now.
    session.execute(delete(MarkingFrontier).where(MarkingFrontier.detection_id == detection.id))
    session.execute(delete(MarkingProgress).where(MarkingProgress.detection_id == detection.id))
    session.flush()
