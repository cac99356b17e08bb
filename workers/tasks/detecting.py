"""One shard of a detection run: find vertices and pair them with camera frames."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from math import sqrt
from uuid import UUID

import numpy as np
from sqlalchemy import and_, delete, exists, select, update
from sqlalchemy.orm import Session

from apexcal.documents.corners import TOP, nearest
from apexcal.documents.states import UNENDED, WorkState
from service.platform.broker.hints import hint
from service.platform.db.annotations import Answer
from service.platform.db.base import Json
from service.platform.db.clock import now
from service.platform.db.detections import Apex, Detection, Vertex, VertexFrame
from service.platform.db.recordings import CameraFrame, Recording, Sensor
from service.platform.jobs.claims import Claim, Lease
from workers.tasks.context import Context
from workers.tasks.originals import open_lidar, said_still
from workers.tasks.vertex_rows import Pair, Pairs, moved_places, write_vertices
from workers.vertices.detectors import detect_range
from workers.vertices.pairing import on_track, pair, pair_interpolated
from workers.vertices.pose_detection import SAME_PLACE_M, fixed_place
from workers.vertices.region import Region
from workers.vertices.tracks import MARGIN_SWEEPS
from workers.vertices.vertex import Detections, spread_order

_REPORT_EVERY = 50
# By sweep, the frame of each mark and the place of its apex.
_Marked = Mapping[int, Sequence[tuple[int, Sequence[float]]]]


def detect(context: Context, claim: Claim, lease: Lease) -> Callable[[Session], Detection | None]:
    """Detect in the sweeps ``first`` to ``stop`` of the payload, or in all of them."""
    with context.database.reading() as session:
        run = session.get_one(Detection, claim.subject_id)
        key = session.get_one(Sensor, run.lidar_id).blob_key
        cameras = _camera_stamps(session, run.recording_id)
        marked = _marked_frames(session, run.lidar_id)
        still = said_still(session, run.recording_id)
    with context.scratch() as folder, open_lidar(context, key, folder) as lidar:
        shard = range(claim.payload.get("first", 0), claim.payload.get("stop", len(lidar)))
        region = Region.from_document(run.region)

        def report(index: int) -> None:
            lease.check()
            if (index - shard.start) % _REPORT_EVERY == 0:
                lease.report((index - shard.start) / max(len(shard), 1), "looking for the board's corner")

        margin = 0 if run.pairing["mode"] == "nearest" else MARGIN_SWEEPS
        batch = detect_range(
            lidar, region, run.detector, run.options, indices=shard, on_sweep=report, margin=margin, still=still
        )
    pairs = {sensor: _pair(batch, stamps, run.pairing, marked.get(sensor, {})) for sensor, stamps in cameras.items()}
    return writing(run, batch, pairs)


def writing(run: Detection, batch: Detections, pairs: Pairs) -> Callable[[Session], Detection | None]:
    """Return the function that writes a shard's vertices and pairs, and hands over the detection to be marked."""

    def write(session: Session) -> Detection | None:
        # Runs of one recording share its apexes, so they write one after the other.
        of_recording = select(Recording.id).where(Recording.id == run.recording_id)
        session.execute(of_recording.with_for_update(key_share=True))
        row = session.scalars(select(Detection).where(Detection.id == run.id).with_for_update()).one()
        if row.state in UNENDED:
            write_vertices(session, run, batch.vertices, pairs)
            _advance(session, row, batch)
        return row if row.counts.get("paired") and row.state == WorkState.RUNNING else None

    return write


def _camera_stamps(session: Session, recording_id: UUID) -> dict[UUID, np.ndarray]:
    """(M,) int64 stamps of every camera's frames, in the order of their indices."""
    rows = session.execute(
        select(CameraFrame.sensor_id, CameraFrame.stamp_ns)
        .join(Sensor, Sensor.id == CameraFrame.sensor_id)
        .where(Sensor.recording_id == recording_id)
        .order_by(CameraFrame.sensor_id, CameraFrame.index)
    )
    stamps: dict[UUID, list[int]] = defaultdict(list)
    for sensor_id, stamp_ns in rows:
        stamps[sensor_id].append(stamp_ns)
    return {sensor_id: np.array(values, np.int64) for sensor_id, values in stamps.items()}


def _marked_frames(session: Session, lidar_id: UUID) -> dict[UUID, _Marked]:
    """Return people's marks in each camera of the apexes of a LiDAR, the last mark first."""
    rows = session.execute(
        select(Answer.sensor_id, Answer.frame_index, Apex.sweep_index, Apex.x, Apex.y, Apex.z)
        .join(Apex, Apex.id == Answer.apex_id)
        .where(Apex.lidar_id == lidar_id, Answer.is_mark, Apex.corner == TOP)
        .order_by(Answer.created_at.desc(), Answer.id)
    )
    marked: dict[UUID, dict[int, list[tuple[int, Sequence[float]]]]] = defaultdict(lambda: defaultdict(list))
    for sensor_id, frame_index, sweep_index, *xyz in rows:
        marked[sensor_id][sweep_index].append((frame_index, xyz))
    return dict(marked)


def _pair(batch: Detections, stamps: np.ndarray, pairing: Json, marked: _Marked) -> list[Pair | None]:
    """Return each vertex's frame, or None if none is near enough. Still poses have no track to be moved along.

    A vertex keeps the frame in which people marked it as far as its track reaches.
    """
    of_marks = [nearest(marked.get(vertex.sweep_index, ()), vertex.xyz) for vertex in batch.vertices]
    near = {
        "offset_ns": pairing["offset_ns"],
        "max_gap_ns": pairing["max_gap_ns"],
        "marked": np.array([-1 if frame is None else frame for frame in of_marks], np.int64),
    }
    times = np.array([vertex.time_ns for vertex in batch.vertices], np.int64)
    index, gap = pair(times, stamps, **near)
    rows = zip(index.tolist(), gap.tolist(), strict=True)
    closest = [Pair(frame, gap_ns) if frame >= 0 else None for frame, gap_ns in rows]
    if pairing["mode"] == "nearest" or batch.poses is not None:
        return closest
    track = pair_interpolated(batch.vertices, stamps, context=batch.context, **near)
    rows = zip(batch.vertices, track.index.tolist(), track.xyz, track.covariance, strict=True)
    along = [
        Pair(frame, 0, moved_places(vertex, xyz, spread)) if frame >= 0 else None
        for vertex, frame, xyz, spread in rows
    ]
    if pairing["mode"] == "interpolate":
        return along
    # The ring rules state no covariances: a moved vertex beside one that stayed would state what the other does not.
    tracked = on_track(batch.vertices, batch.context).tolist()
    moves = [yes and vertex.covariance is not None for yes, vertex in zip(tracked, batch.vertices, strict=True)]
    return [moved if yes else stayed for yes, moved, stayed in zip(moves, along, closest, strict=True)]


def _advance(session: Session, row: Detection, batch: Detections) -> None:
    """Add this shard's counts; the last one settles the pairs, orders the vertices, says when there is nothing."""
    before = row.counts
    counts = {
        "sweeps": before.get("sweeps", 0) + batch.frames,
        "accepted": before.get("accepted", 0) + len(batch.vertices),
        "rejected": _added(before, "rejected", batch.rejected),
        "quality": _added(before, "quality", Counter(vertex.quality for vertex in batch.vertices if vertex.quality)),
        "flags": _added(before, "flags", Counter(flag for vertex in batch.vertices for flag in vertex.flags)),
        "examples": {**batch.examples, **before.get("examples", {})},
        "refused_sweeps": _runs(before.get("refused_sweeps", {}), batch.refused),
    }
    if batch.poses is not None:
        counts |= {
            "poses": batch.poses.count,
            "poses_stated": batch.poses.stated,
            "poses_walked": batch.poses.walked,
        }
    if batch.size is not None:
        counts["size"] = asdict(batch.size)
    counts |= _rolls(before.get("roll"), [vertex.roll[0] for vertex in batch.vertices if vertex.roll])
    row.state = WorkState.RUNNING
    if row.remaining == 1:
        counts |= _settle_frames(session, row) | _places(session, row, counts)
        _order(session, row.id)
        problem = _nothing_found(session, row, counts)
        if problem:
            row.state, row.problem, row.finished_at = WorkState.FAILED, problem, now()
            hint(session, row.fleet_id, "detection", row.id)
    row.counts = counts
    session.flush()


def _places(session: Session, row: Detection, counts: Json) -> Json:
    """Count the still poses: where the board stands as in the sweep before, somebody else moved."""
    if not counts.get("poses"):
        return {}
    alike = np.count_nonzero(np.linalg.norm(np.diff(_tips(session, row), axis=0), axis=1) < SAME_PLACE_M)
    return {"poses": max(1, counts["poses"] - int(alike))}


def _nothing_found(session: Session, row: Detection, counts: Json) -> Json | None:
    """Return the problem of a run that looked at nothing, or at something that never moves."""
    if counts["rejected"].get("no_points", 0) == counts["sweeps"]:
        return _NOTHING
    if counts.get("poses"):
        return None
    tips = _tips(session, row)
    fixed_xyz = fixed_place(tips)
    if fixed_xyz is None:
        return None
    x, y, z = fixed_xyz
    return {
        "code": "fixed_object",
        "detail": f"The corner stands at one place in nearly all of {len(tips)} sweeps: x {x:.2f}, y {y:.2f}, "
        f"z {z:.2f} m. That is an object of the surroundings, not a board that somebody moves.",
        "hint": "Leave that place out of the region. If the board itself stood there, upload with --still.",
    }


def _tips(session: Session, row: Detection) -> np.ndarray:
    """(N, 3) metres, in the order of their sweeps."""
    columns = select(Vertex.x, Vertex.y, Vertex.z).where(Vertex.detection_id == row.id, Vertex.corner == TOP)
    rows = session.execute(columns.order_by(Vertex.sweep_index)).all()
    return np.array([tuple(xyz) for xyz in rows], np.float64).reshape(-1, 3)


def _added(before: Json, name: str, more: Mapping[str, int]) -> dict[str, int]:
    """Add up the counts of all shards so far under a name, by reason, class or flag."""
    return dict(sorted((Counter(before.get(name, {})) + Counter(more)).items()))


def _runs(before: Mapping[str, list[list[int]]], refused: Mapping[int, str]) -> dict[str, list[list[int]]]:
    """Return, by reason, [first, last] of each run of neighbouring sweeps refused for it, of all shards so far."""
    runs: dict[str, list[list[int]]] = defaultdict(list)
    earlier = [(first, last, name) for name, of_reason in before.items() for first, last in of_reason]
    for first, last, name in sorted([*earlier, *((index, index, reason) for index, reason in refused.items())]):
        of_reason = runs[name]
        if of_reason and of_reason[-1][1] == first - 1:
            of_reason[-1][1] = last
        else:
            of_reason.append([first, last])
    return dict(sorted(runs.items()))


def _rolls(before: Mapping[str, float] | None, rolls: list[float]) -> Json:
    """Return the rolls of the board in the vertices of all shards so far; empty if no vertex tells."""
    if not rolls:
        return {"roll": before} if before else {}
    earlier, mean, spread = (
        (before[key] for key in ("vertices", "mean_deg", "spread_deg")) if before else (0, 0.0, 0.0)
    )
    more = np.degrees(rolls)
    count = earlier + more.size
    both = (earlier * mean + float(more.sum())) / count
    squares = earlier * (spread**2 + (mean - both) ** 2) + float(np.sum((more - both) ** 2))
    return {"roll": {"vertices": count, "mean_deg": both, "spread_deg": sqrt(squares / count)}}


def _settle_frames(session: Session, run: Detection) -> dict[str, int]:
    """Leave each frame to the sweep whose tip people marked in it, else to the nearest in time.

    A mark belongs to a frame and means one vertex. Returns how many sweeps have a frame of some camera, and how many
    lost theirs to another one.
    """
    is_marked = exists().where(
        Answer.apex_id == Vertex.apex_id,
        Answer.sensor_id == VertexFrame.sensor_id,
        Answer.frame_index == VertexFrame.frame_index,
        Answer.is_mark,
    )
    of_frame = and_(CameraFrame.sensor_id == VertexFrame.sensor_id, CameraFrame.index == VertexFrame.frame_index)
    # Not the stored gap, which is zero for every vertex that was moved.
    rows = session.execute(
        select(
            VertexFrame.sensor_id,
            VertexFrame.frame_index,
            CameraFrame.stamp_ns - Vertex.time_ns,
            Vertex.sweep_index,
            is_marked,
        )
        .join(Vertex, Vertex.id == VertexFrame.vertex_id)
        .join(CameraFrame, of_frame)
        .where(Vertex.detection_id == run.id, Vertex.corner == TOP)
        .order_by(Vertex.time_ns, Vertex.id)
    ).all()
    closest: dict[tuple[UUID, int], tuple[tuple[bool, int], int]] = {}
    lost: list[tuple[UUID, int, int]] = []
    for sensor_id, frame_index, difference_ns, sweep, marked in rows:
        away = (not marked, abs(difference_ns - run.pairing["offset_ns"]))
        other = closest.get((sensor_id, frame_index))
        if other and other[0] <= away:
            lost.append((sensor_id, frame_index, sweep))
            continue
        if other:
            lost.append((sensor_id, frame_index, other[1]))
        closest[sensor_id, frame_index] = (away, sweep)
    for sensor_id, frame_index, sweep in lost:
        of_frame = (VertexFrame.sensor_id == sensor_id, VertexFrame.frame_index == frame_index)
        of_sweep = (Vertex.id == VertexFrame.vertex_id, Vertex.detection_id == run.id, Vertex.sweep_index == sweep)
        session.execute(delete(VertexFrame).where(*of_frame, exists().where(*of_sweep)))
    paired = {sweep for _, sweep in closest.values()}
    return {"paired": len(paired), "frame_taken": len({sweep for *_, sweep in lost} - paired)}


def _order(session: Session, detection_id: UUID) -> None:
    """Rank the sweeps. The corners of a sweep have its rank."""
    columns = select(Vertex.id, Vertex.sweep_index, Vertex.corner).where(Vertex.detection_id == detection_id)
    rows = session.execute(columns.order_by(Vertex.time_ns, Vertex.id)).all()
    sweeps = [sweep for _, sweep, corner in rows if corner == TOP]
    ranks = dict(zip(sweeps, spread_order(len(sweeps)), strict=True))
    if rows:
        session.execute(update(Vertex), [{"id": vertex_id, "rank": ranks[sweep]} for vertex_id, sweep, _ in rows])


_NOTHING: Json = {
    "code": "region_keeps_nothing",
    "detail": "No point of any sweep lies inside the region.",
    "hint": "Ask for a preview of the region and widen it: it should hold the person and the board wherever they "
    "walk, and as little else as possible.",
}
