"""`python -m benchmarks.detection.ringless`: still poses before drawn sensors without rings.

DRAWS (default 6) recordings of each case from SEED on; CASES does some. Six poses each, the size stated, the region
a box before the sensor. Gross: the vertex, or another corner that is stated, lies farther than 0.1 m from the true
one, or there is no such board. ``twice``: poses with two vertices. A walk is refused as a whole. SUGGEST=0 asks for
no suggested region, which takes most of the time.
"""

from __future__ import annotations

import os
import secrets
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import NamedTuple

import numpy as np

from apexcal.documents.corners import CORNERS
from apexcal.documents.errors import InputError
from benchmarks.detection.sizes import GROSS_M
from tests.support.scenes.ringless import CASES, Case, draw_poses
from workers.vertices.detectors import detect_range
from workers.vertices.region import Region
from workers.vertices.suggestion import suggest
from workers.vertices.sweep_source import Listed

REGION = Region.from_document({"all": [{"box": {"min": [1.0, -2.2, -1.0], "max": [5.1, 2.2, 1.6]}}]})


class RinglessRow(NamedTuple):
    """What one recording gave.

    Attributes:
        off_m, chi: of each vertex: the largest distance of its corners; scaled squared error of the vertex.
        twice: poses with more than one vertex.
        answer: of the suggestion, or of a refusal.
    """

    seed: int
    poses: int
    off_m: list[float]
    chi: list[float]
    twice: int
    answer: str


def run(asked: tuple[int, Case]) -> RinglessRow:
    """Draw a recording, and look for its board."""
    seed, case = asked
    posed = draw_poses(seed, case)
    source = Listed(posed.sweeps)
    poses = len(set(posed.pose[np.isfinite(posed.corners[:, 0, 0]) & (posed.pose >= 0)].tolist()))
    size = {"board_width_m": posed.edges_m[0], "board_height_m": posed.edges_m[1], "upper_corner": posed.upper_corner}
    answer = _suggestion(source) if os.environ.get("SUGGEST") != "0" else ""
    try:
        vertices = detect_range(source, REGION, "refined", size, indices=range(len(source)), still=True).vertices
    except InputError as error:
        return RinglessRow(seed, poses, [], [], 0, f"{answer}, {error.code}")
    off: list[float] = []
    chi: list[float] = []
    for vertex in vertices:
        true = posed.corners[vertex.sweep_index]
        places = {"top": vertex.xyz}
        if vertex.corners is not None:
            places |= dict(zip(vertex.corners.names, vertex.corners.xyz, strict=True))
        apart = [float(np.linalg.norm(np.array(xyz) - true[CORNERS.index(name)])) for name, xyz in places.items()]
        off.append(max(apart) if np.isfinite(true).all() else np.inf)
        gap = _angles(np.array(vertex.xyz)) - _angles(true[0])
        chi.append(float(gap @ np.linalg.solve(np.array(vertex.covariance), gap)) / 3.0)
    in_pose = posed.pose[[vertex.sweep_index for vertex in vertices]]
    twice = sum(int(np.count_nonzero(in_pose == number)) > 1 for number in set(in_pose.tolist()) - {-1})
    return RinglessRow(seed, poses, off, chi, twice, answer)


def _suggestion(source: Listed) -> str:
    try:
        suggest(source, still=True)
    except InputError as error:
        return error.code
    return "region"


def _angles(xyz: np.ndarray) -> np.ndarray:
    flat = float(np.hypot(xyz[0], xyz[1]))
    return np.array([np.arctan2(xyz[1], xyz[0]), np.arctan2(xyz[2], flat), np.hypot(flat, xyz[2])])


def main() -> None:
    seed, draws = int(os.environ.get("SEED") or secrets.randbits(30)), int(os.environ.get("DRAWS") or 6)
    cases = [case for case in CASES if case in (os.environ.get("CASES") or ",".join(CASES)).split(",")]
    with ProcessPoolExecutor(int(os.environ.get("CORES") or 2), mp_context=get_context("spawn")) as pool:
        every = list(pool.map(run, [(seed + k, case) for case in cases for k in range(draws)]))
    for number, case in enumerate(cases):
        rows = every[number * draws : (number + 1) * draws]
        off, chi = (np.array([value for row in rows for value in row[k]]) for k in (2, 3))
        gross = off > GROSS_M
        line = (
            f"{case}: {off.size} vertices of {sum(row.poses for row in rows)} poses, gross {np.count_nonzero(gross)}"
        )
        if (~gross).any():
            line += f", median {1e3 * np.median(off[~gross]):.0f} mm, chi-square {np.mean(chi[~gross]):.2f}"
        bad = [row.seed - seed for row in rows if any(value > GROSS_M for value in row.off_m)]
        print(f"{line}, twice {sum(row.twice for row in rows)}, gross in {bad}; {[row.answer for row in rows]}")
    print(f"seed {seed}")


if __name__ == "__main__":
    main()
