"""The board's other corners after its apex was moved: along its track to another moment, or to a mean of sweeps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from apexcal.documents.corners import CornerName
from workers.geometry.spherical import axes, to_spherical
from workers.vertices.vertex import Corners, Floats, Vertex

Narrow = Callable[[Floats, Floats], Floats]


class MovedCorner(NamedTuple):
    """A corner at another moment: (3,) metres, LiDAR frame; (3, 3) over azimuth (rad), elevation (rad), range (m)."""

    name: CornerName
    xyz: Floats
    covariance: Floats


def moved(vertex: Vertex, xyz: Floats, covariance: Floats) -> list[MovedCorner]:
    """The corners of a vertex that was moved to ``xyz`` (3,), with the covariance (3, 3) that it has there.

    The board keeps its attitude. The error of a corner's offset from the apex correlates with the error of the apex
    in its own sweep. Where other sweeps reduced that error, only the rest counts: along each axis the smaller
    variance of the sweep's own and the track's.
    """
    if vertex.corners is None:
        return []
    joint = _joint_xyz(vertex)
    own: Floats = joint[0, :, 0, :]
    there = axes(xyz[None])[0]
    P = there @ covariance @ there.T
    # In axes where the sweep's own covariance is the unit matrix and the track's is diagonal.
    root: Floats = np.asarray(np.linalg.cholesky(own), np.float64)
    inverse: Floats = np.asarray(np.linalg.inv(root), np.float64)
    size, axis = np.linalg.eigh(inverse @ P @ inverse.T)
    half = root @ axis
    left: Floats = (half * np.minimum(size, 1.0)) @ half.T
    gain = inverse.T @ inverse @ left
    moved_corners: list[MovedCorner] = []
    for index, (name, corner) in enumerate(zip(vertex.corners.names, vertex.corners.xyz, strict=True), start=1):
        at = xyz + np.array(corner) - np.array(vertex.xyz)
        cross: Floats = joint[index, :, 0, :] - own
        both = cross @ gain
        spread = P + both + both.T + joint[index, :, index, :] - cross - cross.T - own
        moved_corners.append(MovedCorner(name, at, to_spherical(spread[None], at[None])[0]))
    return moved_corners


def of_mean(vertices: Sequence[Vertex], narrowed: Narrow) -> Corners | None:
    """The corners of the mean of some sweeps of one still pose: those that all of them have.

    Args:
        narrowed: the covariance (3, 3) of a mean over x, y, z, from the covariance that a sweep states on average and
            from the sweeps' values (N, 3). The correlations between corners are scaled in the same way.
    """
    having = [vertex.corners for vertex in vertices if vertex.corners is not None]
    if not having or len(having) < len(vertices):
        return None
    names: list[CornerName] = [name for name in having[0].names if all(name in corners.names for corners in having)]
    if not names:
        return None
    places: Floats = np.array(
        [
            [vertex.xyz, *(corners.xyz[corners.names.index(name)] for name in names)]
            for vertex, corners in zip(vertices, having, strict=True)
        ]
    )
    joint: Floats = np.mean([_taken(corners, names) for corners in having], axis=0)
    middle: Floats = places.mean(axis=0)
    scaled = np.zeros_like(joint)
    for k, at in enumerate(axes(middle)):
        block = slice(3 * k, 3 * k + 3)
        stated: Floats = at @ joint[block, block] @ at.T
        after: Floats = np.asarray(np.linalg.cholesky(narrowed(stated, places[:, k])), np.float64)
        before: Floats = np.asarray(np.linalg.cholesky(stated), np.float64)
        scaled[block, block] = np.linalg.inv(at) @ after @ np.linalg.inv(before) @ at
    return Corners.of(names, middle[1:], scaled @ joint @ scaled.T)


def _joint_xyz(vertex: Vertex) -> Floats:
    """(K, 3, K, 3) covariance over x, y, z of the apex and its corners."""
    assert vertex.corners is not None
    at = axes(np.array([vertex.xyz, *vertex.corners.xyz]))
    joint = np.array(vertex.corners.covariance).reshape(len(at), 3, len(at), 3)
    return np.einsum("iab,ibjc,jdc->iajd", at, joint, at)


def _taken(corners: Corners, names: Sequence[CornerName]) -> Floats:
    """The joint covariance of the apex and these corners."""
    positions = np.array([0, *(1 + corners.names.index(name) for name in names)])
    rows = np.add.outer(3 * positions, np.arange(3)).ravel()
    return np.array(corners.covariance)[np.ix_(rows, rows)]
