"""Any detector over still poses: no static background, no track, and one vertex while the board stands still.

The sweeps of a pose share most of their error, because the same rings meet the same board. So their mean vertex gains
only in the part of the covariance by which the sweeps differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.detectors import Options
from workers.geometry.spherical import to_spherical, to_xyz
from workers.vertices.corners import mean_corners
from workers.vertices.region import Region
from workers.vertices.static_background import Foreground
from workers.vertices.still_poses import StillPoses
from workers.vertices.sweep_source import OnSweep, Run, SweepSource
from workers.vertices.vertex import Answers, Rejection, Vertex

Floats = NDArray[np.float64]

_FEWEST_FIXED: Final = 8
FIXED_M: Final = 0.05  # who stands still sways by as much
_NEARLY_ALL: Final = 0.9
# Where most sweeps of a pose agree, those that put the apex farther away saw something else.
SAME_PLACE_M: Final = 0.1
AGREE: Final = 16.3  # chi-square of three: 99.9 % of the errors that a vertex states
# A difference between few sweeps is uncertain. As many imagined ones do not differ, so that S is rather too small.
_IMAGINED: Final = 4


def detect_poses(
    source: SweepSource,
    region: Region,
    poses: StillPoses,
    run: Run,
    options: Options,
    indices: range,
    on_sweep: OnSweep,
) -> Answers:
    """Return one answer for each sweep of ``indices``; one of a pose's agreeing sweeps has their vertex.

    A pose that reaches beyond ``indices`` is looked at whole, so that its vertex is the same in every shard.
    """
    wider = range(poses.pose_of(indices.start).start, poses.pose_of(indices.stop - 1).stop)
    alone = {**options, "track": 0.0} if "track" in options else options
    run_answers = run(source, Foreground(region, poses.foreground, not poses.single), alone, wider, on_sweep)
    outcomes = list(run_answers.outcomes)
    for number, index in enumerate(wider):
        if outcomes[number] == Rejection("no_points") and region.inside(source.sweep(index)).any():
            outcomes[number] = Rejection("nothing_differs")
    answers: list[Vertex | Rejection] = []
    at = wider.start
    while at < wider.stop:
        pose = poses.pose_of(at)
        answers += merge_pose(outcomes[pose.start - wider.start : pose.stop - wider.start])
        at = pose.stop
    return replace(run_answers, outcomes=answers[indices.start - wider.start : indices.stop - wider.start])


def fixed_place(xyz: Floats) -> tuple[float, float, float] | None:
    """Return the place where nearly all vertices (N, 3) of a walk stand, if there is one: that is no board."""
    if len(xyz) < _FEWEST_FIXED:
        return None
    middle = np.median(xyz, axis=0)
    if np.mean(np.linalg.norm(xyz - middle, axis=1) <= FIXED_M) < _NEARLY_ALL:
        return None
    x, y, z = middle.tolist()
    return x, y, z


def merge_pose(outcomes: Sequence[Vertex | Rejection]) -> list[Vertex | Rejection]:
    """Return the answers of a pose's sweeps with one vertex for each run of sweeps that agree within their errors.

    It is their mean and stands in the middle sweep. A person who sways out of these errors gets a vertex for each
    place, because sweeps may have images of their own.
    """
    vertices = [(number, vertex) for number, vertex in enumerate(outcomes) if isinstance(vertex, Vertex)]
    if len(vertices) < 2:
        return list(outcomes)
    xyz = np.array([vertex.xyz for _, vertex in vertices])
    apart = np.linalg.norm(xyz[:, None] - xyz[None, :], axis=2)
    middle = int(np.argmin(np.median(apart, axis=1)))
    near = apart[middle] <= SAME_PLACE_M
    if 2 * np.count_nonzero(near) <= len(near):
        near[:] = True  # the board was moved, though nothing else differs
    rows: list[list[tuple[int, Vertex]]] = []
    for k in np.flatnonzero(near):
        if not rows or not _agree(rows[-1][0][1], vertices[k][1]):
            rows.append([])
        rows[-1].append(vertices[k])
    answers: list[Vertex | Rejection] = [
        Rejection("same_pose") if isinstance(answer, Vertex) else answer for answer in outcomes
    ]
    for row in rows:
        home, vertex = row[len(row) // 2]
        answers[home] = _mean(vertex, [other for _, other in row]) if len(row) > 1 else vertex
    return answers


def _agree(first: Vertex, other: Vertex) -> bool:
    """Return whether two vertices differ by no more than the first one's stated errors, or by `SAME_PLACE_M`."""
    off = np.array(other.xyz) - np.array(first.xyz)
    if first.covariance is None:
        return float(np.linalg.norm(off)) <= SAME_PLACE_M
    covariance = to_xyz(np.array([first.covariance]), np.array([first.xyz]))[0]
    scaled: Floats = np.asarray(np.linalg.solve(covariance, off), np.float64)
    return float(off @ scaled) <= AGREE


def _mean(home: Vertex, vertices: Sequence[Vertex]) -> Vertex:
    """Return the vertex of ``home``'s sweep at the mean of all, with the covariance of that mean.

    Of the covariance C that each sweep states, only the part S by which the sweeps differ is its own. So their mean
    has C - (1 - 1/n) S.
    """
    values = np.array([vertex.xyz for vertex in vertices])
    mean = values.mean(axis=0)
    x, y, z = mean.tolist()
    stated = [vertex.covariance for vertex in vertices if vertex.covariance is not None]
    covariance = None
    if len(stated) == len(vertices):
        common = to_xyz(np.mean(np.array(stated), axis=0), mean)
        (aa, ae, ar), (ea, ee, er), (ra, re, rr) = to_spherical(_covariance_of_mean(common, values), mean).tolist()
        covariance = (aa, ae, ar), (ea, ee, er), (ra, re, rr)
    flags = tuple(sorted({flag for vertex in vertices for flag in vertex.flags}))
    points = sum(vertex.points_used for vertex in vertices)
    return replace(
        home,
        xyz=(x, y, z),
        points_used=points,
        covariance=covariance,
        flags=flags,
        corners=mean_corners(vertices, _covariance_of_mean),
    )


def _covariance_of_mean(stated: Floats, values: Floats) -> Floats:
    """Return C - (1 - 1/n) S, in axes where C is the unit matrix and no eigenvalue of S is above 1."""
    n = len(values)
    root = np.linalg.cholesky(stated)
    white: Floats = np.asarray(np.linalg.solve(root, (values - values.mean(axis=0)).T), np.float64)
    size, axes = np.linalg.eigh(white @ white.T / (n - 1 + _IMAGINED))
    left = 1.0 - (1.0 - 1.0 / n) * np.minimum(size, 1.0)
    half = root @ axes
    result: Floats = (half * left) @ half.T
    return result
