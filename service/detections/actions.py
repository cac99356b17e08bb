"""Asking for marks of other corners than the tip: each corner gets a vertex of its own.

So tasks, answers, verdicts and disclosures of a corner are those of its vertex.
"""

from __future__ import annotations

from collections.abc import Sequence
from uuid import UUID

from sqlalchemy import delete, select
from sqlalchemy.orm import Session

from apexcal.documents.corners import CORNERS, TOP, CornerName
from apexcal.documents.detections import DetectionRequest
from apexcal.documents.detectors import resolve_options
from service.detections.corner_vertices import make_corners, named
from service.detections.jobs import AT_ONCE, queue_corners
from service.platform.db.annotations import MarkingFrontier, MarkingProgress
from service.platform.db.base import content_hash
from service.platform.db.detections import Detection, Vertex, marked_corners
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


# Vertices whose corners are looked at together.
_LOOK = 200


def ask_corners(session: Session, detection: Detection, corners: Sequence[CornerName]) -> None:
    """Have these corners of a finished detection's vertices marked, and no others. What was marked stays.

    Those that people get first are made here, the others of a long walk by jobs.

    Raises:
        Problem: 409 ``corners_not_known``, no vertex states one of them.
    """
    # The lock: runs of one recording share its apexes, and nobody may be given a task meanwhile.
    lock = select(Recording.id).where(Recording.id == detection.recording_id).with_for_update(key_share=True)
    session.execute(lock)
    session.refresh(detection, ["marked_corners"])
    before = marked_corners(detection)
    added: list[CornerName] = [name for name in CORNERS if name in corners and name != TOP and name not in before]
    for corner in added:
        _require_stated(session, detection, corner)
    detection.marked_corners = [name for name in CORNERS if name in corners]
    session.flush()
    if added:
        make_corners(session, detection, range(AT_ONCE))
        queue_corners(session, detection)
    # Whoever had no vertex left may have one now.
    session.execute(delete(MarkingFrontier).where(MarkingFrontier.detection_id == detection.id))
    session.execute(delete(MarkingProgress).where(MarkingProgress.detection_id == detection.id))
    session.flush()


def _require_stated(session: Session, detection: Detection, corner: CornerName) -> None:
    of_tips = (
        select(Vertex.corners)
        .where(Vertex.detection_id == detection.id, Vertex.corner == TOP, Vertex.corners.is_not(None))
        .order_by(Vertex.rank)
        .execution_options(yield_per=_LOOK)
    )
    with session.execute(of_tips) as tips:
        stated = any(named(tip.corners, corner) for tip in tips)
    if not stated:
        raise conflict(
            "corners_not_known",
            f"No sweep of this detection states the board's {corner} corner.",
            "Detect again with the detector refined and the board's measured size (options board_width_m and "
            "board_height_m).",
            corner=corner,
        )
