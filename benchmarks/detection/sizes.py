"""`python -m benchmarks.detection.sizes`: the board's size from subsets of poses of drawn sensors, people and boards.

DRAWS (default 6) recordings from SEED on; of each, one random subset of 8, 16 and 32 poses. Size open, stated right,
and stated 5 and 10 % wrong (both edges, either sign). Gross: farther than 0.1 m from the true apex.
"""

from __future__ import annotations

import os
import secrets
import sys
from collections import defaultdict
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from typing import Final

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
Row = tuple[str, int, int, bool, int, int, int, list[float], float, bool]


def run(seed: int, counts: Sequence[int] = _COUNTS, cases: Sequence[str] = _CASES) -> list[Row]:
    """Rows of case, seed, poses, whether four rings meet eight boards, boards, vertices, gross ones, errors (m),
    deviations of the size, and whether the stated size is contradicted."""
    drawn = draw(seed)
    random = np.random.default_rng([seed, 77])
    sweeps, apexes, rings = poses_of(drawn, random)
    region, edges = Region.from_document(drawn.region()), np.array(drawn.board_m)
    rows: list[Row] = []
    for count in counts:
        chosen = random.permutation(len(sweeps))[:count]
        poses = Listed([replace(sweeps[k], stamp_ns=_POSE_NS * index) for index, k in enumerate(chosen)])
        enough = int(np.count_nonzero(rings[chosen] >= _FOUR_RINGS)) >= min(_COUNTS)
        factors = {"open": 0.0, "right": 1.0}
        factors |= {f"{percent} % wrong": 1.0 + 0.01 * percent * random.choice([-1.0, 1.0]) for percent in (5, 10)}
        for case in cases:
            factor = factors[case]
            width, height = (factor * edges).tolist()
            stated = {"board_width_m": width, "board_height_m": height}
            answer = detect_range(poses, region, "refined", stated, indices=range(len(chosen)))
            off = [
                float(np.linalg.norm(np.array(vertex.xyz) - apexes[chosen[vertex.sweep_index]]))
                for vertex in answer.vertices
            ]
            z = np.nan
            if answer.size is not None:
                z = float(
                    np.max(np.abs(np.array(answer.size.seen_m) - np.sort(edges)) / np.array(answer.size.sigma_m))
                )
            contradicted = answer.size is not None and answer.size.contradicts
            gross = sum(metres > GROSS_M for metres in off)
            rows.append((case, seed, count, enough, len(chosen), len(off), gross, off, z, contradicted))
    return rows


def poses_of(drawn: DrawnScene, random: np.random.Generator) -> tuple[list[Sweep], Floats, NDArray[np.int64]]:
    """Sweeps at random moments of a walk in which two rings or more meet the board, their apexes and their rings."""
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
    return sweeps, np.array(apexes), np.array(rings)


def main() -> None:
    seed, draws = int(os.environ.get("SEED") or secrets.randbits(30)), int(os.environ.get("DRAWS") or 6)
    cases: dict[str, list[Row]] = defaultdict(list)
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        for rows in pool.map(run, range(seed, seed + draws)):
            for row in rows:
                cases[row[0]].append(row)
                if "-v" in sys.argv:
                    median = float(np.median(row[7])) if row[7] else np.nan
                    print(
                        f"  {row[:7]} median {1e3 * median:.0f} mm, z {row[8]:.1f}, contradicted {row[9]}", flush=True
                    )
    for case, rows in cases.items():
        off = np.concatenate([row[7] for row in rows])
        z = np.array([row[8] for row in rows])
        z = z[np.isfinite(z)]
        enough = [row for row in rows if row[3]]
        print(
            f"{case}: {len(rows)} subsets, empty {sum(not row[5] for row in rows)}, of them with four rings on eight "
            f"boards {sum(not row[5] for row in enough)} of {len(enough)}; vertices {off.size} of "
            f"{sum(row[4] for row in rows)}, gross {sum(row[6] for row in rows)}, median "
            f"{1e3 * float(np.median(off)):.0f} mm; contradicted {sum(row[9] for row in rows)}; size reported "
            f"{z.size}, within 2.5 deviations {np.count_nonzero(z < 2.5)}"
        )
    print(f"seed {seed}")


if __name__ == "__main__":
    main()
