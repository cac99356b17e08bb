"""Vectors of overlays for other implementations: ``python -m tests.workers.overlays.overlay_vectors`` writes them
anew. The pages' node tests read the file, and a test beside this holds it to ``workers/overlays``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.workers.geometry.projection_vectors import LENSES, transform
from workers.overlays.camera import camera_of
from workers.overlays.motion import Moment, motion_at, moved
from workers.overlays.visible import visible

FILE = Path(__file__).with_suffix(".json")
RINGS, COLUMNS = 16, 120
SIZE = (1920, 1200)
STAMP_NS = 5_000_000_000
TURN_NS = 100_000_000
# A walker goes to the left and away; the track is open after the third vertex.
VERTICES = [
    Moment(STAMP_NS + ms * 1_000_000, 5.0 + 0.0005 * ms, -0.5 + 0.0012 * ms, 0.55) for ms in (-60, 45, 150, 4000)
]
# Amid the sweep, long after it, and where the track is open.
MOMENTS_NS = (STAMP_NS + 30_000_000, STAMP_NS + 149_000_000, STAMP_NS + 1_000_000_000)


def sweep() -> dict[str, Any]:
    """Walls all around at 20 m, a panel of 3 m at 4 m ahead, and the board before the panel's left edge."""
    ring, column = np.divmod(np.arange(RINGS * COLUMNS), COLUMNS)
    azimuth = -np.pi + 2 * np.pi * (column + 0.5) / COLUMNS
    elevation = np.radians(2.0 * (ring - (RINGS - 1) / 2))
    rays = np.column_stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    )
    ahead = rays[:, 0]
    times = np.round(TURN_NS * (column + 0.5) / COLUMNS)
    at = rays * (20.0 / np.maximum(np.abs(ahead), 0.05))[:, None]
    for distance, left, right, below, above in ((9.0, 1.5, -1.5, -1.5, 1.5), (5.0, 0.0, -1.0, -0.3, 0.6)):
        plane = rays * (distance / np.maximum(ahead, 1e-9))[:, None]
        y, z = plane[:, 1], plane[:, 2]
        on = (ahead > 0.1) & (y < left) & (y > right) & (z > below) & (z < above)
        at[on] = plane[on]
    return {
        "stamp_ns": STAMP_NS,
        "rings": ring.tolist(),
        "points": np.round(at, 3).tolist(),
        "times_ns": times.astype(int).tolist(),
    }


def case_of(lens: dict[str, Any], at_ns: int, of: dict[str, Any]) -> dict[str, Any]:
    """What is seen of the sweep through a lens, with the walker at a moment."""
    points: NDArray[np.float32] = np.array(of["points"], np.float32)
    motion = motion_at(VERTICES, at_ns)
    found = moved(points, STAMP_NS + np.array(of["times_ns"]), motion) if motion else None
    seen = visible(found.points if found else points, np.array(of["rings"]), camera_of(lens, transform()), SIZE)
    return {
        "intrinsics": lens,
        "transform": transform(),
        "at_ns": at_ns,
        "moved": found and {"count": found.number, "farthest_m": found.farthest_m},
        "pixels": np.round(seen.pixels, 9).tolist(),
        "distance_m": np.round(seen.distance.astype(np.float64), 4).tolist(),
        "hidden": seen.hidden,
    }


def document() -> dict[str, Any]:
    """The sweep, the track and all cases."""
    of = sweep()
    chosen = [(LENSES[0], MOMENTS_NS[0]), (LENSES[2], MOMENTS_NS[1]), (LENSES[3], MOMENTS_NS[2])]
    chosen += [(LENSES[5], MOMENTS_NS[0])]
    cases = [case_of(lens, at_ns, of) for lens, at_ns in chosen]
    return {"size": SIZE, "sweep": of, "vertices": [one._asdict() for one in VERTICES], "cases": cases}


if __name__ == "__main__":
    whole = document()
    lines = [f'"{name}": {json.dumps(whole[name])}' for name in ("size", "vertices", "sweep")]
    cases = ",\n".join(json.dumps(case) for case in whole["cases"])
    FILE.write_text("{" + ",\n".join(lines) + f',\n"cases": [\n{cases}\n]}}\n')
