# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false
"""Boards of sensors without rings, solid-state ones for instance, on still poses.

The points of a pose are put together. No ray tells where nothing came back, so the posterior of the tip allows every
board that holds the points: it is as wide as the gap between their hull and the board's outline.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from apexcal.documents.detectors import Options
from apexcal.documents.errors import InputError
from workers.vertices.board.estimate import CONFIDENT, locate
from workers.vertices.board.model import EDGE_M, BoardModel, Plane, any_roll
from workers.vertices.board.plane_learning import BIAS_M
from workers.vertices.board.planes import grow_planes
from workers.vertices.board.rays import likelihood_ratios
from workers.vertices.board.run import LEAST_POINTS, is_board, refused, vertex_of
from workers.vertices.board.size import BEAM_SIGMA_RAD
from workers.vertices.board.surroundings import no_board
from workers.vertices.range_image import clusters
from workers.vertices.region import Region
from workers.vertices.sensor_grid import some_grid
from workers.vertices.still_poses import SAME_POSE
from workers.vertices.sweep_source import OnSweep, SweepSource
from workers.vertices.vertex import Answers, PoseFacts, Rejection, Vertex

Floats = NDArray[np.float64]
_BESIDE_M: Final = 0.1
_PIECES: Final = 8


def any_rings(source: SweepSource) -> bool:
    """Whether the sensor has rings; without any, all points are of ring 0."""
    return not len(source) or bool(source.sweep(0).ring.any())


def run_ringless(
    source: SweepSource, region: Region, options: Options, indices: range, still: bool, on_sweep: OnSweep
) -> tuple[Answers, PoseFacts]:
    """Return one vertex for each still pose, in its middle sweep, and how many poses there are.

    Raises:
        InputError: ``points_without_rings`` if poses are not stated to be still.
    """
    if not still:
        raise InputError(
            "points_without_rings",
            "The LiDAR has no rings: a board is found only where it stands still.",
            "Record still poses, and say so: `--still`.",
        )
    clouds = [sweep.xyz[region.mask(sweep.xyz)].astype(np.float64) for sweep in map(source.sweep, range(len(source)))]
    poses = _poses(clouds)
    together = [np.concatenate([clouds[index] for index in pose]) for pose in poses]
    up = np.array([options["up_x"], options["up_y"], options["up_z"]])
    model = _model(source, options, up)
    answers: list[Vertex | Rejection] = []
    for number, pose in enumerate(poses):
        answer: list[Vertex | Rejection] = [Rejection("same_pose")] * len(pose)
        middle = pose[len(pose) // 2]
        others = [cloud for other, cloud in enumerate(together) if other != number]
        if not set(pose).isdisjoint(indices):
            found = _look(_moving(together[number], others), model, options, middle, source.sweep(middle).stamp_ns)
            if model.upper_corner and not others and isinstance(found, Vertex):
                found = Rejection("upright_object", "which no other pose shows to be carried", found.points_used)
            answer = [found] * len(pose) if isinstance(found, Rejection) else answer
            answer[middle - pose.start] = found
            on_sweep(middle)
        answers += answer
    return Answers(answers[indices.start : indices.stop]), PoseFacts(len(poses), True)


def _model(source: SweepSource, options: Options, up: Floats) -> BoardModel:
    edges = float(options["board_width_m"]), float(options["board_height_m"])
    growth_rad = 1e-3 * float(options["edge_growth_mrad"])
    corner = int(options["upper_corner"])
    return BoardModel(
        some_grid(source),
        edges=edges,
        slack=0.0,
        upper_corner=corner,
        roll=any_roll(edges, corner),
        bias=BIAS_M,
        growth=max(growth_rad, 0.0),
        growth_sigma=BEAM_SIGMA_RAD if growth_rad < 0.0 else 0.0,
        poses=True,
        shown=True,
    )


def _poses(clouds: Sequence[Floats]) -> list[range]:
    """Return the sweeps in a row that show the same as the first of them."""
    poses: list[range] = []
    for index, cloud in enumerate(clouds):
        first = clouds[poses[-1].start] if poses else cloud
        if poses and min(_share(first, cloud), _share(cloud, first)) >= SAME_POSE:
            poses[-1] = range(poses[-1].start, index + 1)
        else:
            poses.append(range(index, index + 1))
    return poses


def _share(cloud: Floats, other: Floats) -> float:
    """Share of a cloud's points (N, 3) that have one of the other's beside them."""
    return float(_beside(cloud, other).mean()) if len(cloud) and len(other) else float(len(cloud) == len(other))


def _moving(cloud: Floats, others: Sequence[Floats]) -> Floats:
    """The points (N, 3) that at most half of the other poses show, too."""
    same = np.sum([_beside(cloud, other) for other in others if len(other)], axis=0)
    return cloud[np.broadcast_to(same <= 0.5 * len(others), len(cloud))]


def _beside(cloud: Floats, other: Floats) -> NDArray[np.bool_]:
    """(N,) whether one of the other's points lies beside each of the cloud's."""
    distance: Floats = np.asarray(KDTree(other).query(cloud, distance_upper_bound=_BESIDE_M)[0], np.float64)
    return distance < _BESIDE_M


def _look(xyz: Floats, model: BoardModel, options: Options, index: int, stamp_ns: int) -> Vertex | Rejection:
    if not len(xyz):
        return Rejection("no_points")
    if not all(model.edges):
        return Rejection("size_not_stated")
    label = clusters(xyz, _BESIDE_M)
    sizes = np.bincount(label)
    pieces = [xyz[label == piece] for piece in np.argsort(-sizes)[:_PIECES] if sizes[piece] >= LEAST_POINTS]
    fixes = [fix for piece in pieces if (fix := locate(_plane(piece, model), model)) is not None]
    if not fixes:
        return Rejection("not_a_board")
    fix = max(fixes, key=lambda fix: (fix.explained, fix.plane.points))
    if not is_board(fix, model, LEAST_POINTS):
        return refused("not_a_board", fix, no_board(fix, model, LEAST_POINTS))
    if math.degrees(fix.sigma) > options["max_sigma_deg"]:
        return refused("too_uncertain", fix, f"its tip is known to {math.degrees(fix.sigma):.2f} degrees")
    return vertex_of(index, stamp_ns, fix, (), options, model)


def _plane(xyz: Floats, model: BoardModel) -> Plane:
    """The plane of most of the points (N, 3), and which of them lie on it."""
    middle: Floats = np.median(xyz, axis=0)
    xyz = xyz[np.argsort(np.linalg.norm(xyz - middle, axis=1))]
    x, y, _ = middle.tolist()
    c, s = x / math.hypot(x, y), y / math.hypot(x, y)
    R_window_lidar = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ model.grid.R_level_lidar
    x, y, z = R_window_lidar @ xyz.T
    azimuth, distance = np.arctan2(y, x), np.hypot(x, y)
    slope = z / distance
    # The points at the middle start the plane, as a segment and its neighbour do on rings.
    start = int(np.count_nonzero(np.linalg.norm(xyz - xyz[0], axis=1) < _BESIDE_M))
    image = azimuth[None], slope[None], distance[None]
    segment, pair = np.array([[0.0, 0.0, start - 1.0]]), np.zeros((1, 2), np.int64)
    prior, sigma = np.array([*model.yaw, *model.tilt]), model.sigma
    every = np.ones((1, len(xyz)), np.bool_)
    w, spread, score = np.zeros(3), np.eye(3), 0.0
    for _ in range(2):
        planes, infos, scores, _ = grow_planes(*image, every, segment, pair, sigma, prior)
        best = int(np.argmax(scores))
        w, spread, score = planes[best], np.asarray(np.linalg.inv(infos[best]), np.float64), float(scores[best])
        off = np.abs(distance - 1.0 / (w @ np.stack([np.cos(azimuth), np.sin(azimuth), slope])))
        sigma = max(EDGE_M, 1.4826 * float(np.median(off[off < 4.0 * sigma])))
    at = likelihood_ratios(*image, w, spread, sigma, model.lost)
    left, up, ratio = (part[0] for part in at)
    hits, none = ratio > CONFIDENT, np.zeros(len(xyz), np.bool_)
    on_plane = np.stack([left[hits], up[hits]])
    missed = ratio < 1.0 / CONFIDENT
    return Plane(
        R_window_lidar=R_window_lidar,
        w=w,
        spread=spread,
        uneven=np.zeros((3, 3)),
        score=score,
        left=left,
        up=up,
        reach=np.linalg.norm(xyz, axis=1),
        ratio=ratio,
        below=none,
        mixed=none,
        hits=on_plane,
        misses=np.stack([left[missed], up[missed], np.zeros(np.count_nonzero(missed))]),
        near=np.stack([*on_plane, np.ones(on_plane.shape[1])]),
        rings=0,
        top_ring=0,
        points=int(np.count_nonzero(hits)),
        width=float(np.ptp(on_plane[0])) if hits.any() else 0.0,
        returned=~none,
        telling=True,
    )
