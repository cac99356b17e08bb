"""Marks as people make them, and the errors that pairs share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.pairs import MARKED_BY, SIGMAS
from benchmarks.coverage.walks import Paired
from workers.geometry.spherical import axes
from workers.simulation.walker import Poses

Floats = NDArray[np.float64]
PEOPLE: Final = 3
BIAS_PX: Final = 0.3
NOISE_PX: Final = 1.0
_IMPORTED: Final = ("x", "y", "z", "u", "v", "group")


@dataclass(frozen=True)
class Errors:
    """What is wrong with a recording besides the vertices' and marks' own noise.

    ``blunders``: share of marks on another corner of the board.
    ``on_hand``: share of marks on the hand below the tip. ``noises_px``: of the people, stated by each mark
    where there are several. ``elevation_deg``: of all vertices. ``pose_m``: offset of each pose of a still board, the
    same for its pairs. ``second_half_deg``: turn of the mount about the vertical in the
    second half. ``line_time_us``: of a rolling shutter.
    """

    blunders: float = 0.0
    on_hand: float = 0.0
    noises_px: tuple[float, ...] = (NOISE_PX,)
    elevation_deg: float = 0.0
    pose_m: float = 0.0
    second_half_deg: float = 0.0
    line_time_us: float = 0.0


def columns(paired: Paired, errors: Errors, random: np.random.Generator) -> dict[str, list[Any]]:
    """The columns of a correspondence set, as marks make them."""
    count = len(paired.xyz)
    person = random.integers(PEOPLE, size=count)
    noise = np.array(errors.noises_px)[person % len(errors.noises_px)]
    bias = random.normal(0.0, BIAS_PX, (PEOPLE, 2))
    marks = _marked(paired, errors, random) + bias[person] + noise[:, None] * random.normal(size=(count, 2))
    xyz = paired.xyz + _moved(paired, errors, random)
    known: dict[str, Any] = dict(zip(("x", "y", "z"), xyz.T.tolist(), strict=True))
    known |= dict(zip(("u", "v"), marks.T.tolist(), strict=True))
    known |= {"stamp_ns": paired.stamps_ns.tolist(), "gap_ns": [0] * count, "sweep_index": paired.sweeps.tolist()}
    known |= {"frame_index": paired.frames.tolist(), "marks": [1] * count, "spread_px": [0.0] * count}
    known[MARKED_BY] = [[one] for one in person.tolist()]
    known |= dict(zip(SIGMAS, paired.sigmas.T.tolist(), strict=True))
    if len(errors.noises_px) > 1:
        known["sigma_px"] = np.hypot(noise, BIAS_PX).tolist()
    if errors.pose_m or paired.is_still:
        known["group"] = paired.pose.tolist()
    # Pairs of a still board come from a file, which says no more than this.
    return {name: known[name] for name in _IMPORTED} if paired.is_still else known


def _marked(paired: Paired, errors: Errors, random: np.random.Generator) -> Floats:
    """(N, 2) where the corners that people take for the apex really are."""
    camera, taken = paired.camera, paired.taken_ns
    pixels = camera.project(_turned(paired, errors, paired.places(taken)))
    for _ in range(2 if errors.line_time_us else 0):  # the row is where the apex was when the row was read
        rows = np.clip(pixels[:, 1], 0.0, camera.image_size[1] - 1.0) - 0.5 * camera.image_size[1]
        read = taken + np.round(rows * errors.line_time_us * 1e3).astype(np.int64)
        pixels = camera.project(paired.places(read))
    wrong = np.flatnonzero(random.uniform(size=len(taken)) < errors.blunders)
    if wrong.size:
        corners = _other_corners(paired.walked.poses(taken[wrong]), random)
        pixels[wrong] = camera.project(corners)
    wrong = np.flatnonzero(random.uniform(size=len(taken)) < errors.on_hand) if errors.on_hand else wrong[:0]
    if wrong.size:
        pixels[wrong] = camera.project(_hand(paired.walked.poses(taken[wrong]), random))
    return np.where(np.isfinite(pixels), pixels, 0.0)


def _hand(poses: Poses, random: np.random.Generator) -> Floats:
    """(M, 3) a hand's place: below the tip by the same share of the board all the time, to two centimetres."""
    left, right = (
        length * edge for length, edge in zip(poses.board_m, (poses.edge_left, poses.edge_right), strict=True)
    )
    share = random.uniform(0.35, 0.75)
    return poses.apex + share * (left + right) + random.normal(0.0, 0.02, poses.apex.shape)


def _other_corners(poses: Poses, random: np.random.Generator) -> Floats:
    left, right = (
        length * edge for length, edge in zip(poses.board_m, (poses.edge_left, poses.edge_right), strict=True)
    )
    corners = poses.apex + np.stack([left, right, left + right])
    return corners[random.integers(3, size=len(poses.apex)), np.arange(len(poses.apex))]


def _turned(paired: Paired, errors: Errors, apex: Floats) -> Floats:
    if not errors.second_half_deg:
        return apex
    angle = np.radians(errors.second_half_deg)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    late = paired.taken_ns > np.median(paired.taken_ns)
    return np.where(late[:, None], apex @ turn.T, apex)


def _moved(paired: Paired, errors: Errors, random: np.random.Generator) -> Floats:
    """(N, 3) what vertices are off besides their detector's errors, metres."""
    moved = np.radians(errors.elevation_deg) * axes(paired.xyz)[:, :, 1]
    if errors.pose_m:
        moved = moved + random.normal(0.0, errors.pose_m, (int(paired.pose.max()) + 1, 3))[paired.pose]
    return moved
