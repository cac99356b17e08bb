"""Asking for marks of other corners than the tip: each corner gets a vertex of its own.

So tasks, answers, verdicts and disclosures of a corner are those of its vertex.
"""

from __future__ import annotations

from collections.abc import Sequence

from sqlalchemy import delete, select
from sqlalchemy.orm import Session

from apexcal.documents.corners import CORNERS, TOP, CornerName
from service.detections.corner_vertices import make_corners, named
from service.detections.jobs import AT_ONCE, queue_corners
from service.platform.db.annotations import MarkingFrontier, MarkingProgress
from service.platform.db.detections import Detection, Vertex, marked_corners
from service.platform.db.recordings import Recording
from service.platform.http.problems import Problem

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
        raise Problem(
            409,
            "corners_not_known",
            f"No vertex of this detection states the board's {corner} corner.",
            "Detect again with the detector refined and the board's measured size (options board_width_m and "
            "board_height_m).",
            corner=corner,
        )
