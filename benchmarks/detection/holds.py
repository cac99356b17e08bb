"""`python -m benchmarks.detection.holds`: drawn poses with the board in any hold, and as drawn.

DRAWS (default 6) recordings from SEED on, 16 poses each, the size stated, the body 0.3 m behind the board unless it
is said. ``mirrored``: the board's edges and its roll mirrored in every second pose; ``rolled``: by 18 degrees to
either side; ``torso``: the body 5, 10 and 15 cm behind it; ``gripped``: the same, and hands on both lower edges;
``child``: 1.2 m tall; ``second``: another person beside or behind; ``level``: two edges level, and the upper left
corner is looked for.
"""

from __future__ import annotations

import os
import secrets
from collections import defaultdict
from dataclasses import replace
from typing import Final

import numpy as np

from benchmarks.detection.sizes import GROSS_M, poses_of
from tests.support.scenes.drawn import DrawnScene, draw
from workers.vertices.detectors import detect_range
from workers.vertices.region import Region
from workers.vertices.sweep_source import Listed

HOLDS: Final = (
    "plain", "mirrored", "rolled", "leaning", "turned", "torso", "gripped", "child", "second", "level",
)  # fmt: skip
_POSES, _POSE_NS = 16, 5_000_000_000
Row = tuple[int, list[float]]


def run(seed: int, hold: str) -> Row:
    """Return how many poses were looked at, and how far each vertex lies from the true apex, metres."""
    drawn = draw(seed)
    random = np.random.default_rng([seed, 78])
    scenes = _scenes(drawn, hold)
    parts = [poses_of(scene, random, _POSES // len(scenes)) for scene in scenes]
    sweeps = [sweep for part in parts for sweep in part[0]]
    apexes = np.concatenate([part[1] for part in parts])
    order = random.permutation(len(sweeps))
    source = Listed([replace(sweeps[k], stamp_ns=_POSE_NS * index) for index, k in enumerate(order)])
    width, height = drawn.board_m
    size = {"board_width_m": width, "board_height_m": height}
    if hold == "level":
        size["upper_corner"] = 1
    region = Region.from_document(drawn.region())
    vertices = detect_range(source, region, "refined", size, indices=range(len(sweeps))).vertices
    off = [float(np.linalg.norm(np.array(vertex.xyz) - apexes[order[vertex.sweep_index]])) for vertex in vertices]
    return len(sweeps), off


def _scenes(drawn: DrawnScene, hold: str) -> list[DrawnScene]:
    """Return the scenes that share the poses."""
    usual = replace(drawn.hold, body_behind_m=drawn.hold.torso_m + 0.3)
    behind = [replace(usual, body_behind_m=usual.torso_m + gap) for gap in (0.05, 0.1, 0.15)]
    drawn = replace(drawn, hold=usual)
    match hold:
        case "mirrored":
            mirrored = replace(usual, rolled_deg=-usual.rolled_deg)
            return [drawn, replace(drawn, board_m=drawn.board_m[::-1], hold=mirrored)]
        case "rolled":
            holds = [replace(usual, rolled_deg=rolled) for rolled in (18.0, -18.0)]
        case "leaning":
            holds = [replace(usual, tilted_deg=35.0)]
        case "turned":
            holds = [replace(usual, turned_deg=turned) for turned in (60.0, -60.0)]
        case "level":
            holds = [replace(usual, rolled_deg=45.0)]
        case "torso":
            holds = [replace(each, hand_m=0.0) for each in behind]
        case "gripped":
            holds = [replace(each, hand_m=0.06) for each in behind]
        case "child":
            return [replace(drawn, disturbances=drawn.disturbances.model_copy(update={"walker_height_m": 1.2}))]
        case "second":
            others = [
                drawn.disturbances.model_copy(update={"second_person": place}) for place in ("beside", "behind")
            ]
            return [replace(drawn, disturbances=other) for other in others]
        case _:
            holds = [usual]
    return [replace(drawn, hold=each) for each in holds]


def main() -> None:
    seed, draws = int(os.environ.get("SEED") or secrets.randbits(30)), int(os.environ.get("DRAWS") or 6)
    rows: dict[str, list[Row]] = defaultdict(list)
    for index in range(draws):
        for hold in HOLDS:
            rows[hold].append(run(seed + index, hold))
    for hold, some in rows.items():
        off = np.concatenate([off for _, off in some])
        median = f"{1e3 * float(np.median(off)):.0f} mm" if off.size else "none"
        gross = np.count_nonzero(off > GROSS_M)
        print(f"{hold}: {off.size} of {sum(poses for poses, _ in some)} poses, gross {gross}, median {median}")
    print(f"seed {seed}")


if __name__ == "__main__":
    main()
