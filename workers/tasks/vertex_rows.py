"""Rows of what a shard found: a vertex for each corner of the board that a sweep shows, with its apex and frames."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any
from uuid import UUID

import numpy as np
from numpy.typing import ArrayLike
from sqlalchemy import insert, select
from sqlalchemy.orm import Session

from apexcal.documents.corners import TOP, CornerName, nearest
from service.platform.db.base import Json, new_id
from service.platform.db.detections import Apex, Detection, Vertex, VertexFrame
from workers.vertices.corners import Floats, move_corners
from workers.vertices.vertex import Vertex as DetectedVertex

_DIGITS = 9  # nothing is known better
# An apex's id and place.
_ApexPlace = tuple[UUID, Sequence[float]]
Places = Mapping[CornerName, Json]
"""Columns of each corner that is known, the tip first: x, y, z, covariance."""


@dataclass(frozen=True, slots=True)
class Pair:
    """A vertex's frame in one camera: ``gap_ns`` is frame time minus vertex time.

    ``places``: where the corners were at the frame's time, if the vertex was moved to it.
    """

    frame_index: int
    gap_ns: int
    places: Places = field(default_factory=dict)


Pairs = Mapping[UUID, Sequence[Pair | None]]


def moved_places(vertex: DetectedVertex, xyz: Floats, covariance: Floats) -> Places:
    """Return where the corners are if their vertex was moved to ``xyz`` (3,), covariance (3, 3)."""
    moved = move_corners(vertex, xyz, covariance)
    places: dict[CornerName, Json] = {TOP: _place(xyz, covariance.tolist())}
    places.update((corner.name, _place(corner.xyz, _short(corner.covariance))) for corner in moved)
    return places


def write_vertices(session: Session, run: Detection, vertices: Sequence[DetectedVertex], pairs: Pairs) -> None:
    """Write all corners of these vertices. ``pairs``: each vertex's frame, by camera."""
    apexes = _nearby_apexes(session, run.lidar_id, [vertex.sweep_index for vertex in vertices])
    rows: dict[type[Any], list[Json]] = {Apex: [], Vertex: [], VertexFrame: []}
    for number, vertex in enumerate(vertices):
        of_sweep = {"lidar_id": run.lidar_id, "sweep_index": vertex.sweep_index}
        paired = [(sensor, pair) for sensor, of_sensor in pairs.items() if (pair := of_sensor[number])]
        for corner, location in _places(vertex).items():
            own = {"id": new_id(), "corner": corner, **of_sweep}
            xyz = {axis: location[axis] for axis in "xyz"}
            apex_id = nearest(apexes[vertex.sweep_index, corner], [*xyz.values()])
            if apex_id is None:
                apex_id = new_id()
                rows[Apex].append(own | xyz | {"id": apex_id, "recording_id": run.recording_id})
            rows[Vertex].append(own | location | _measured(run, vertex, corner) | {"apex_id": apex_id})
            rows[VertexFrame] += [_frame(own["id"], sensor, pair, corner) for sensor, pair in paired]
    for row, values in rows.items():
        if values:
            # Of the tables: SQLAlchemy groups rows of classes by which of their columns are null.
            session.execute(insert(row.__table__), values)


def _places(vertex: DetectedVertex) -> Places:
    places: dict[CornerName, Json] = {TOP: _place(vertex.xyz, vertex.covariance)}
    if vertex.corners is not None:
        joint = np.array(vertex.corners.covariance)
        for number, (name, xyz) in enumerate(zip(vertex.corners.names, vertex.corners.xyz, strict=True), start=1):
            block = slice(3 * number, 3 * number + 3)
            places[name] = _place(xyz, _short(joint[block, block]))
    return places


def _place(xyz: ArrayLike, covariance: Any) -> Json:
    return dict(zip("xyz", np.asarray(xyz, np.float64).tolist(), strict=True)) | {"covariance": covariance}


def _short(matrix: Floats) -> list[list[float]]:
    return [[float(f"{value:.{_DIGITS}g}") for value in line] for line in matrix.tolist()]


def _measured(run: Detection, vertex: DetectedVertex, corner: CornerName) -> Json:
    lower = None
    if corner == TOP and vertex.corners is not None:
        lower = [line[: row + 1] for row, line in enumerate(_short(np.array(vertex.corners.covariance)))]
    return {
        "detection_id": run.id,
        "rank": 0,
        "time_ns": vertex.time_ns,
        "ring": vertex.ring,
        "points": vertex.points_used,
        "quality": vertex.quality,
        "flags": list(vertex.flags),
        "corner_covariance": lower,
    }


def _frame(vertex_id: UUID, sensor_id: UUID, pair: Pair, corner: CornerName) -> Json:
    location = pair.places.get(corner) or dict.fromkeys((*"xyz", "covariance"))
    paired = {"frame_index": pair.frame_index, "gap_ns": pair.gap_ns}
    return {"vertex_id": vertex_id, "sensor_id": sensor_id, **paired, **location}


def _nearby_apexes(session: Session, lidar_id: UUID, sweeps: list[int]) -> dict[tuple[int, str], list[_ApexPlace]]:
    apexes: dict[tuple[int, str], list[_ApexPlace]] = defaultdict(list)
    if sweeps:
        statement = select(Apex.sweep_index, Apex.corner, Apex.id, Apex.x, Apex.y, Apex.z).where(
            Apex.lidar_id == lidar_id, Apex.sweep_index.between(min(sweeps), max(sweeps))
        )
        for sweep, corner, apex_id, *xyz in session.execute(statement):
            apexes[sweep, corner].append((apex_id, xyz))
    return apexes
