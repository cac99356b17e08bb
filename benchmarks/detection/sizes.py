"""`python -m benchmarks.detection.sizes`: the board's size from subsets of poses of drawn sensors, people and boards.

DRAWS (default 6) recordings from SEED on; of each, one random subset of 8, 16 and 32 poses. Size open, stated right,
and stated 5 and 10 % wrong (both edges, either sign). Gross: farther than 0.1 m from the true apex.
"""

from __future__ import annotations

import os
import secrets
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tests.support.scenes.drawn import DrawnScene, draw
from workers.readers.recording import Sweep
from workers.simulation.beams import BOARD
from workers.vertices.detectors import detect_range
from workers.vertices.region import Region
from workers.vertices.sweep_source import Listed

_COUNTS: Final = (8, 16, 32)
_POSES, _WALK_S, _POSE_NS = 36, 60.0, 5_000_000_000
_CASES: Final = ("open", "right", "5 % wrong", "10 % wrong")
GROSS_M: Final = 0.1
_FOUR_RINGS: Final = 4
Floats = NDArray[np.float64]


class SizeRow(NamedTuple):
    """What one subset of poses told.

    Attributes:
        enough: whether four rings meet eight boards.
        off_m: of each vertex, from the true apex.
        z: deviations of the size, not a number if none is told.
    """

    case: str
    poses: int
    enough: bool
    off_m: list[float]
    z: float
    contradicted: bool

    @property
    def gross(self) -> int:
        """How many vertices are gross."""
        return sum(metres > GROSS_M for metres in self.off_m)


def run(seed: int, counts: Sequence[int] = _COUNTS, cases: Sequence[str] = _CASES) -> list[SizeRow]:
    """Rows of each count of poses and case."""
    drawn = draw(seed)
    random = np.random.default_rng([seed, 77])
    sweeps, apexes, rings = poses_of(drawn, random)
    region, edges = Region.from_document(drawn.region()), np.array(drawn.board_m)
    rows: list[SizeRow] = []
    for count in counts:
        chosen = random.permutation(len(sweeps))[:count]
        poses = Listed([replace(sweeps[k], stamp_ns=_POSE_NS * index) for index, k in enumerate(chosen)])
        enough = int(np.count_nonzero(rings[chosen] >= _FOUR_RINGS)) >= min(_COUNTS)
        factors = {"open": 0.0, "right": 1.0}
        factors |= {f"{percent} % wrong": 1.0 + 0.01 * percent * random.choice([-1.0, 1.0]) for percent in (5, 10)}
        for case in cases:
            width, height = (factors[case] * edges).tolist()
            stated = {"board_width_m": width, "board_height_m": height}
            answer = detect_range(poses, region, "refined", stated, indices=range(len(chosen)))
            off = [
                float(np.linalg.norm(np.array(one.xyz) - apexes[chosen[one.sweep_index]])) for one in answer.vertices
            ]
            size = answer.size
            z = np.nan
            if size is not None:
                z = float(np.max(np.abs(np.array(size.seen_m) - np.sort(edges)) / np.array(size.sigma_m)))
            rows.append(SizeRow(case, len(chosen), enough, off, z, size is not None and size.contradicts))
    return rows


def poses_of(
    drawn: DrawnScene, random: np.random.Generator, most: int = _POSES
) -> tuple[list[Sweep], Floats, NDArray[np.int64]]:
    """Sweeps at random moments of a walk in which two rings or more meet the board, their apexes and their rings.

    ``most``: as many of them are simulated, whatever is drawn.
    """
    walk, lidar = drawn.simulated(_WALK_S)
    sweeps: list[Sweep] = []
    apexes: list[Floats] = []
    rings: list[int] = []
    for start_s in random.uniform(0.0, _WALK_S - 1.0, _POSES).tolist():
        sweep, surface = lidar.labelled_sweep(len(sweeps), start_s, 0)
        looked_s, apex = start_s, np.zeros(3)
        for _ in range(4):  # the apex moves while the sensor turns towards it
            apex = lidar.in_sensor_frame(walk.poses(np.array([looked_s])).apex)[0]
            looked_s = start_s + float(lidar.scan_seconds(np.arctan2(apex[1], apex[0])))
        count = np.unique(sweep.ring[surface == BOARD]).size
        if count >= 2:
            sweeps.append(sweep)
            apexes.append(apex)
            rings.append(count)
        if len(sweeps) == most:
            break
    return sweeps, np.array(apexes), np.array(rings)


def main() -> None:
    seed, draws = int(os.environ.get("SEED") or secrets.randbits(30)), int(os.environ.get("DRAWS") or 6)
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        every = [row for rows in pool.map(run, range(seed, seed + draws)) for row in rows]
    for case in _CASES:
        rows = [row for row in every if row.case == case]
        off = np.concatenate([row.off_m for row in rows])
        z = np.array([row.z for row in rows if np.isfinite(row.z)])
        enough = [row for row in rows if row.enough]
        print(
            f"{case}: {len(rows)} subsets, {len(enough)} with four rings on eight boards, of these empty "
            f"{sum(not row.off_m for row in enough)}; vertices {off.size} of {sum(row.poses for row in rows)}, gross "
            f"{sum(row.gross for row in rows)}, median {1e3 * float(np.median(off)):.0f} mm; contradicted "
            f"{sum(row.contradicted for row in rows)}; "
            f"size within 2.5 deviations {np.count_nonzero(z < 2.5)} of {z.size}"
        )
    print(f"seed {seed}")


if __name__ == "__main__":
    main()
