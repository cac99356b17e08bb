"""Analyses of a recording: what a region keeps, which region to take, how the two clocks differ."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from itertools import count
from uuid import UUID

import numpy as np
from sqlalchemy import select
from sqlalchemy.orm import Session

from apexcal.documents.corners import TOP
from apexcal.documents.errors import InputError
from apexcal.documents.fit_requests import FitRequest
from service.platform.db.analyses import Analysis
from service.platform.db.base import Json
from service.platform.db.detections import Detection, Vertex
from service.platform.jobs.claims import Claim, Lease
from workers.solver.clock_offset import estimate_offset
from workers.tasks.context import Context
from workers.tasks.originals import lidar_key, open_lidar, said_still, watched
from workers.vertices.pairing import on_track
from workers.vertices.region import Region
from workers.vertices.region import preview as count_kept
from workers.vertices.suggestion import suggest as suggest_region
from workers.vertices.tracks import Track
from workers.vertices.vertex import Covariance
from workers.vertices.vertex import Vertex as Found

_SAMPLES = 360


def preview(context: Context, claim: Claim, lease: Lease) -> Callable[[Session], Json]:
    """Count frames and points inside the region, per ring."""
    question, key = _asked(context, claim)
    with context.scratch() as folder, open_lidar(context, key, folder) as lidar:
        counts = count_kept(
            watched(lidar, range(len(lidar)), lease, "counting points"), Region.from_document(question["region"])
        )
    result: Json = counts.model_dump()
    return lambda session: result


def suggestion(context: Context, claim: Claim, lease: Lease) -> Callable[[Session], Json]:
    """A region around what moves."""
    with context.database.reading() as session:
        analysis = session.get_one(Analysis, claim.subject_id)
        key, still = lidar_key(session, analysis.recording_id), said_still(session, analysis.recording_id)
    calls = count(1)
    with context.scratch() as folder, open_lidar(context, key, folder) as lidar:
        # Each of the sweeps that it looks at is read twice.
        reads = 2 * max(min(_SAMPLES, len(lidar)), 1)

        def report(_: int) -> None:
            lease.report(min(next(calls) / reads, 1.0), "looking for what moves")

        suggested = suggest_region(lidar, samples=_SAMPLES, on_sweep=report, still=still)
    result: Json = {"region": suggested.document, "facts": dict(suggested.facts)}
    return lambda session: result


def clock_offset(context: Context, claim: Claim, lease: Lease) -> Callable[[Session], Json]:
    """The offset between the clocks, from a detection's vertices and what people marked."""
    lease.report(0.0, "fitting the camera and its clock")
    with context.database.reading() as session:
        analysis = session.get_one(Analysis, claim.subject_id)
        vertices = _vertices(session, analysis.detection_id)
        poses = said_still(session, analysis.recording_id) or bool(
            session.get_one(Detection, analysis.detection_id).counts.get("poses")
        )
        paired_under_ns = session.get_one(Detection, analysis.detection_id).pairing["offset_ns"]
    must_move(vertices, poses)
    marks = analysis.asked["marks"]
    estimate = estimate_offset(
        Track.of(vertices),
        np.array(marks["stamp_ns"], np.int64),
        np.column_stack([marks["u"], marks["v"]]).astype(np.float64),
        FitRequest.model_validate(analysis.asked["fit_request"]),
        stop=lease,
        about_ns=paired_under_ns,  # marks exist only on frames that were paired under it
    )
    result: Json = asdict(estimate)
    return lambda session: result


def must_move(vertices: Sequence[Found], poses: bool) -> None:
    """Refuse still poses, said to be or by their vertices. Raises InputError ``offset_not_determined``."""
    if poses or not on_track(vertices).any():
        raise InputError(
            "offset_not_determined",
            "The board does not move while it is recorded: still poses look alike under every offset of the clocks.",
            "Record a walk with the board, 60 s or longer, and estimate the offset from it.",
        )


def _asked(context: Context, claim: Claim) -> tuple[Json, str]:
    """Return an analysis's question, and the key of its recording's LiDAR."""
    with context.database.reading() as session:
        analysis = session.get_one(Analysis, claim.subject_id)
        return analysis.asked, lidar_key(session, analysis.recording_id)


def _vertices(session: Session, detection_id: UUID | None) -> list[Found]:
    """A detection's vertices (tips) as its detector gave them, in the order of their times."""
    detector = session.get_one(Detection, detection_id).detector
    tips = select(Vertex).where(Vertex.detection_id == detection_id, Vertex.corner == TOP)
    rows = session.scalars(tips.order_by(Vertex.time_ns))
    return [
        Found(
            xyz=(row.x, row.y, row.z),
            time_ns=row.time_ns,
            ring=row.ring,
            sweep_index=row.sweep_index,
            points_used=row.points,
            detector=detector,
            covariance=_covariance(row.covariance),
        )
        for row in rows
    ]


def _covariance(lines: list[list[float]] | None) -> Covariance | None:
    if lines is None:
        return None
    first, second, third = ((a, b, c) for a, b, c in lines)
    return first, second, third
