"""Vertices of the corners that people are to mark, for a part of a detection's ranks."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike
from sqlalchemy.orm import Session

from apexcal.documents.corners import CornerName
from service.platform.db.base import Json
from service.platform.jobs.claims import Claim, Lease
from workers.tasks.context import Context
from workers.vertices.corners import Floats, move_corners
from workers.vertices.vertex import Corners, Vertex


def corners(context: Context, claim: Claim, lease: Lease) -> Callable[[Session], range]:
    """Hand over ranks ``first`` to ``stop`` of the payload: their vertices are rows made from rows."""
    ranks = range(claim.payload["first"], claim.payload["stop"])
    return lambda session: ranks


_DIGITS = 9  # nothing is known better


def vertex_columns(corners: Corners | None) -> Json:
    """Columns of a vertex; none where its detector states no corners."""
    if corners is None:
        return {}
    joint = np.array(corners.covariance)
    blocks = [joint[first : first + 3, first : first + 3] for first in range(3, len(joint), 3)]
    lower = [[_short(value) for value in line[: row + 1]] for row, line in enumerate(corners.covariance)]
    stated = [_corner(*corner) for corner in zip(corners.names, corners.xyz, blocks, strict=True)]
    return {"corners": stated, "corner_covariance": lower}


def frame_columns(vertex: Vertex, xyz: Floats, covariance: Floats) -> list[Json] | None:
    """The column of a vertex's frame: its corners, moved with the vertex to ``xyz`` (3,), covariance (3, 3)."""
    return [_corner(*corner) for corner in move_corners(vertex, xyz, covariance)] or None


def _corner(name: CornerName, xyz: ArrayLike, covariance: ArrayLike) -> Json:
    x, y, z = np.asarray(xyz, np.float64).tolist()
    lines = [[_short(value) for value in line] for line in np.asarray(covariance, np.float64).tolist()]
    return {"corner": name, "x": x, "y": y, "z": z, "covariance": lines}


def _short(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")
