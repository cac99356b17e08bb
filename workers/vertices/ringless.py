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

from apexcal.documents.detectors import Options
from apexcal.documents.errors import InputError
from workers.readers.clouds.ring_spread import RINGLESS
from workers.vertices.board.estimate import CONFIDENT, locate
from workers.vertices.board.model import EDGE_M, BoardModel, Plane, any_roll
from workers.vertices.board.plane_learning import BIAS_M
from workers.vertices.board.planes import grow_planes
from workers.vertices.board.rays import likelihood_ratios
from workers.vertices.board.run import LEAST_POINTS, is_board, refused, vertex_of
from workers.vertices.board.size import BEAM_SIGMA_RAD
from workers.vertices.board.surroundings import no_board
from workers.vertices.motion import count_steps
from workers.vertices.range_image import clusters
from workers.vertices.region import Region
from workers.vertices.sensor_grid import some_grid
from workers.vertices.still_poses import STANDS_M
from workers.vertices.suggested_region import things_of
from workers.vertices.sweep_source import OnSweep, SweepSource, spread, stamp_of
from workers.vertices.vertex import Answers, PoseFacts, Rejection, Vertex

Floats = NDArray[np.float64]
_BESIDE_M: Final = 0.05
_SPARSE_M: Final = 0.15
_STRIDES: Final = np.array([1, 1 << 20, 1 << 40])
_TOUCHING: Final = np.array([(i, j, k) for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1)]) @ _STRIDES
_PIECES: Final = 8
_SAMPLES: Final = 4  # sweeps


def any_rings(source: SweepSource) -> bool:
    """Whether the sensor has rings; without any, all points are of ring 0. Sweeps without points tell nothing."""
    rings = (source.sweep(index).ring for index in spread(len(source), _SAMPLES))
    some = next((ring for ring in rings if len(ring)), np.ones(1))
    return bool(some.any())


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
            "The LiDAR has no rings, and the recording is not stated to be of still poses.",
            RINGLESS,
        )
    clouds: list[Floats] = []
    for sweep in map(source.sweep, range(len(source))):
        clouds.append(sweep.xyz[region.mask(sweep.xyz)].astype(np.float64))
        on_sweep(indices.start)  # it may end the work
    poses = _poses(clouds)
    together = _moving([np.concatenate([clouds[index] for index in pose]) for pose in poses])
    if _walked([stamp_of(source, pose.start) for pose in poses], together):
        raise InputError(
            "points_without_rings",
            "The LiDAR has no rings, and the board moves.",
            RINGLESS,
        )
    up = np.array([options["up_x"], options["up_y"], options["up_z"]])
    model = _model(source, options, up)
    answers: list[Vertex | Rejection] = []
    for number, pose in enumerate(poses):
        answer: list[Vertex | Rejection] = [Rejection("same_pose")] * len(pose)
        middle = pose[len(pose) // 2]
        if not set(pose).isdisjoint(indices):
            outcome = _look(together[number], model, options, middle, source.sweep(middle).stamp_ns)
            if model.upper_corner and len(poses) == 1 and isinstance(outcome, Vertex):
                outcome = Rejection("upright_object", "which no other pose shows to be carried", outcome.points_used)
            answer = [outcome] * len(pose) if isinstance(outcome, Rejection) else answer
            answer[middle - pose.start] = outcome
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
    """Return the sweeps in a row in which nothing of a person's size is new beside those before."""
    poses: list[range] = []
    cells = np.zeros(0, np.int64)
    for index, cloud in enumerate(clouds):
        if poses and not things_of(cloud[~_beside(cloud, cells, _SPARSE_M)]):
            poses[-1] = range(poses[-1].start, index + 1)
        else:
            poses.append(range(index, index + 1))
            cells = cells[:0]
        cells = np.union1d(cells, _cells(cloud, _SPARSE_M))
    return poses


def _moving(clouds: Sequence[Floats]) -> list[Floats]:
    """The points (N, 3) of each pose that at most half of the others show, too."""
    cells = [_cells(cloud, _BESIDE_M) for cloud in clouds]
    moving: list[Floats] = []
    for number, cloud in enumerate(clouds):
        same = [_beside(cloud, other, _BESIDE_M) for k, other in enumerate(cells) if k != number]
        moving.append(cloud[np.broadcast_to(np.sum(same, axis=0) <= 0.5 * len(same), len(cloud))])
    return moving


def _walked(stamps_ns: Sequence[int], moving: Sequence[Floats]) -> bool:
    """Whether the largest thing that moves goes on from pose to pose as somebody who walks."""
    things = [(stamp_ns, things_of(cloud)) for stamp_ns, cloud in zip(stamps_ns, moving, strict=True)]
    places = [(stamp_ns, *of_pose[0].middle.tolist()) for stamp_ns, of_pose in things if of_pose]
    steps = count_steps(places)
    return steps.walks > steps.jumps and steps.way_m >= STANDS_M


def _cells(cloud: Floats, cell_m: float) -> NDArray[np.int64]:
    """Ascending numbers of the cells that hold or touch one that holds a point (N, 3)."""
    return np.unique(np.unique(_cell_of(cloud, cell_m))[:, None] + _TOUCHING)


def _beside(cloud: Floats, cells: NDArray[np.int64], cell_m: float) -> NDArray[np.bool_]:
    """Which points (N, 3) lie in some cells."""
    return np.isin(_cell_of(cloud, cell_m), cells)


def _cell_of(cloud: Floats, cell_m: float) -> NDArray[np.int64]:
    return np.floor(cloud / cell_m).astype(np.int64) @ _STRIDES


def _look(xyz: Floats, model: BoardModel, options: Options, index: int, stamp_ns: int) -> Vertex | Rejection:
    if not len(xyz):
        return Rejection("no_points")
    if not all(model.edges):
        return Rejection("size_not_stated")
    label = clusters(xyz, 2.0 * _BESIDE_M)
    sizes = np.bincount(label)
    pieces = [xyz[label == piece] for piece in np.argsort(-sizes)[:_PIECES] if sizes[piece] >= LEAST_POINTS]
    fixes = [fix for piece in pieces if (fix := locate(_plane(piece, model), model)) is not None]
    if not fixes:
        return Rejection("not_a_board")
    fix = max(fixes, key=lambda fix: (fix.explained, fix.plane.points))
    if not is_board(fix, model, LEAST_POINTS):
        return refused("not_a_board", fix, no_board(fix, model, LEAST_POINTS))
    if math.degrees(fix.sigma) > options["max_sigma_deg"]:
        return refused("too_uncertain", fix, f"its corner is known to {math.degrees(fix.sigma):.2f} degrees")
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
    start = int(np.count_nonzero(np.linalg.norm(xyz - xyz[0], axis=1) < 2.0 * _BESIDE_M))
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
