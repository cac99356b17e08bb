"""One shard of a detection run: find vertices, pair them with camera frames, match them to known apexes."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from math import sqrt
from uuid import UUID

import numpy as np
from sqlalchemy import and_, delete, exists, select, update
from sqlalchemy.orm import Session

from apexcal.documents.corners import TOP, nearest
from apexcal.documents.states import UNENDED, WorkState
from service.platform.broker.hints import hint
from service.platform.db.annotations import Answer
from service.platform.db.base import Json, new_id
from service.platform.db.clock import now
from service.platform.db.detections import Apex, Detection, Vertex, VertexFrame
from service.platform.db.recordings import CameraFrame, Recording, Sensor
from service.platform.jobs.claims import Claim, Lease
from workers.tasks.context import Context
from workers.tasks.cornering import frame_columns, vertex_columns
from workers.tasks.originals import open_lidar, said_still
from workers.vertices.detectors import detect_range
from workers.vertices.pairing import on_track, pair, pair_interpolated
from workers.vertices.pose_detection import SAME_PLACE_M, fixed_place
from workers.vertices.region import Region
from workers.vertices.tracks import MARGIN_SWEEPS
from workers.vertices.vertex import Detections, spread_order
from workers.vertices.vertex import Vertex as Found

_REPORT_EVERY = 50
# An apex's id and place.
_Known = tuple[UUID, Sequence[float]]
# By sweep, the frame of each mark and the place of its apex.
_Marked = Mapping[int, Sequence[tuple[int, Sequence[float]]]]


@dataclass(frozen=True, slots=True)
class Pair:
    """A vertex's frame in one camera: ``gap_ns`` is frame time minus vertex time.

    ``xyz`` and ``covariance`` (3 x 3 over azimuth, elevation, range) where the vertex was moved to the frame's time,
    and the board's other ``corners`` with it.
    """

    frame_index: int
    gap_ns: int
    xyz: tuple[float, float, float] | None = None
    covariance: list[list[float]] | None = None
    corners: list[Json] | None = None


Pairs = dict[UUID, list[Pair | None]]


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
            _write_vertices(session, run, batch, pairs)
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
    along = [_moved(vertex, frame, xyz, spread) if frame >= 0 else None for vertex, frame, xyz, spread in rows]
    if pairing["mode"] == "interpolate":
        return along
    # The ring rules state no covariances: a moved vertex beside one that stayed would state what the other does not.
    tracked = on_track(batch.vertices, batch.context).tolist()
    moves = [yes and vertex.covariance is not None for yes, vertex in zip(tracked, batch.vertices, strict=True)]
    return [moved if yes else stayed for yes, moved, stayed in zip(moves, along, closest, strict=True)]


def _moved(vertex: Found, frame: int, xyz: np.ndarray, covariance: np.ndarray) -> Pair:
    x, y, z = xyz.tolist()
    return Pair(frame, 0, (x, y, z), covariance.tolist(), frame_columns(vertex, xyz, covariance))


def _write_vertices(session: Session, run: Detection, batch: Detections, pairs: Pairs) -> None:
    apexes = _known_apexes(session, run.lidar_id, [vertex.sweep_index for vertex in batch.vertices])
    for number, vertex in enumerate(batch.vertices):
        apex_id = nearest(apexes[vertex.sweep_index], vertex.xyz)
        if apex_id is None:
            (x, y, z), apex_id = vertex.xyz, new_id()
            keys = {"id": apex_id, "recording_id": run.recording_id, "lidar_id": run.lidar_id}
            session.add(Apex(**keys, sweep_index=vertex.sweep_index, x=x, y=y, z=z))
        row = _vertex_row(run, apex_id, vertex)
        session.add(row)
        session.add_all(
            _frame_row(row.id, sensor, pair)
            for sensor, of_sensor in pairs.items()
            for pair in of_sensor[number : number + 1]
            if pair
        )
    session.flush()


def _frame_row(vertex_id: UUID, sensor_id: UUID, pair: Pair) -> VertexFrame:
    x, y, z = pair.xyz or (None, None, None)
    return VertexFrame(
        vertex_id=vertex_id,
        sensor_id=sensor_id,
        frame_index=pair.frame_index,
        gap_ns=pair.gap_ns,
        x=x,
        y=y,
        z=z,
        covariance=pair.covariance,
        corners=pair.corners,
    )


def _known_apexes(session: Session, lidar_id: UUID, sweeps: list[int]) -> dict[int, list[_Known]]:
    apexes: dict[int, list[_Known]] = defaultdict(list)
    if sweeps:
        statement = select(Apex.sweep_index, Apex.id, Apex.x, Apex.y, Apex.z).where(
            Apex.lidar_id == lidar_id,
            Apex.corner == TOP,
            Apex.sweep_index.between(min(sweeps), max(sweeps)),
        )
        for sweep, apex_id, *xyz in session.execute(statement):
            apexes[sweep].append((apex_id, xyz))
    return apexes


def _vertex_row(run: Detection, apex_id: UUID, vertex: Found) -> Vertex:
    x, y, z = vertex.xyz
    return Vertex(
        id=new_id(),
        detection_id=run.id,
        lidar_id=run.lidar_id,
        apex_id=apex_id,
        rank=0,
        sweep_index=vertex.sweep_index,
        time_ns=vertex.time_ns,
        x=x,
        y=y,
        z=z,
        ring=vertex.ring,
        points=vertex.points_used,
        quality=vertex.quality,
        flags=list(vertex.flags),
        covariance=[list(line) for line in vertex.covariance] if vertex.covariance else None,
        **vertex_columns(vertex.corners),
    )


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
    rows = session.execute(
        select(Vertex.x, Vertex.y, Vertex.z).where(Vertex.detection_id == row.id).order_by(Vertex.sweep_index)
    ).all()
    xyz = np.array([tuple(each) for each in rows], np.float64).reshape(-1, 3)
    alike = np.count_nonzero(np.linalg.norm(np.diff(xyz, axis=0), axis=1) < SAME_PLACE_M)
    return {"poses": max(1, counts["poses"] - int(alike))}


def _nothing_found(session: Session, row: Detection, counts: Json) -> Json | None:
    """Return the problem of a run that looked at nothing, or at something that never moves."""
    if counts["rejected"].get("no_points", 0) == counts["sweeps"]:
        return _NOTHING
    if counts.get("poses"):
        return None
    rows = session.execute(select(Vertex.x, Vertex.y, Vertex.z).where(Vertex.detection_id == row.id)).all()
    fixed_xyz = fixed_place(np.array([tuple(xyz) for xyz in rows], np.float64).reshape(-1, 3))
    if fixed_xyz is None:
        return None
    x, y, z = fixed_xyz
    return {
        "code": "fixed_object",
        "detail": f"The corner stands at one place in nearly all of {len(rows)} sweeps: x {x:.2f}, y {y:.2f}, "
        f"z {z:.2f} m. That is an object of the surroundings, not a board that somebody moves.",
        "hint": "Leave that place out of the region. If the board itself stood there, upload with --still.",
    }


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
    """Leave each frame to the vertex that people marked in it, else to the nearest in time.

    A mark belongs to a frame and means one vertex. Returns how many vertices have a frame of some camera, and how
    many lost theirs to another one.
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
            VertexFrame.vertex_id,
            is_marked,
        )
        .join(Vertex, Vertex.id == VertexFrame.vertex_id)
        .join(CameraFrame, of_frame)
        .where(Vertex.detection_id == run.id)
        .order_by(Vertex.time_ns, Vertex.id)
    ).all()
    closest: dict[tuple[UUID, int], tuple[tuple[bool, int], UUID]] = {}
    lost: list[tuple[UUID, UUID]] = []
    for sensor_id, frame_index, difference_ns, vertex_id, marked in rows:
        away = (not marked, abs(difference_ns - run.pairing["offset_ns"]))
        other = closest.get((sensor_id, frame_index))
        if other and other[0] <= away:
            lost.append((vertex_id, sensor_id))
            continue
        if other:
            lost.append((other[1], sensor_id))
        closest[sensor_id, frame_index] = (away, vertex_id)
    for vertex_id, sensor_id in lost:
        session.execute(
            delete(VertexFrame).where(VertexFrame.vertex_id == vertex_id, VertexFrame.sensor_id == sensor_id)
        )
    paired = {vertex_id for _, vertex_id in closest.values()}
    return {"paired": len(paired), "frame_taken": len({vertex_id for vertex_id, _ in lost} - paired)}


def _order(session: Session, detection_id: UUID) -> None:
    ids = session.scalars(
        select(Vertex.id).where(Vertex.detection_id == detection_id).order_by(Vertex.time_ns, Vertex.id)
    ).all()
    if ids:
        ranks = zip(ids, spread_order(len(ids)), strict=True)
        session.execute(update(Vertex), [{"id": vertex_id, "rank": rank} for vertex_id, rank in ranks])


_NOTHING: Json = {
    "code": "region_keeps_nothing",
    "detail": "No point of any sweep lies inside the region.",
    "hint": "Ask for a preview of the region and widen it: it should hold the person and the board wherever they "
    "walk, and as little else as possible.",
}
