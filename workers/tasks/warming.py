"""Every kernel compiled, or loaded from the cache, in a worker's parent: its children then have the machine code.

``python -m workers.tasks.warming`` fills the cache (``NUMBA_CACHE_DIR``) before the first worker of a host starts.
"""

from __future__ import annotations

import numpy as np

from workers.readers.recording import Sweep
from workers.solver.slot import warm_up as warm_up_solver
from workers.vertices.detectors import RUNS, detect_range
from workers.vertices.region import Region
from workers.vertices.sweep_source import Listed

# As many as a board is learned from. Learning its size, or how its edges grow, runs the same kernels for longer.
_SWEEPS = 6
_KNOWN = {"board_width_m": 0.6 * 2**0.5, "board_height_m": 0.6 * 2**0.5, "edge_growth_mrad": 0.0}
_REGION = {"all": [{"quantity": "x", "op": ">", "value": 0.0}, {"quantity": "range", "op": "<", "value": 9.0}]}


def warm_up() -> None:
    """Run the solver and all detectors on next to nothing."""
    warm_up_solver()
    warm_up_detectors()


def warm_up_detectors() -> None:
    """Run all detectors on next to nothing."""
    sweeps = Listed([_sweep(number) for number in range(_SWEEPS)])
    region = Region.from_document(_REGION)
    for name in RUNS:
        detect_range(sweeps, region, name, _KNOWN if name == "refined" else None, indices=range(_SWEEPS), margin=0)
    Region.from_document({**_REGION, "up": [0.0, 0.1, 1.0]}).inside(sweeps.sweep(0))


def _sweep(number: int) -> Sweep:
    """A board on its tip, 6 m ahead of a 16-ring LiDAR and before a wall, carried to the left and up."""
    azimuth, elevation = np.meshgrid(np.radians(np.arange(-20.0, 20.0, 0.2)), np.radians(np.arange(-15.0, 16.0, 2.0)))
    rays = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=-1
    )
    on_board = 6.0 * rays / rays[..., :1]
    left, up = 0.1 * number - 0.3, 0.04 * number - 0.1
    hit = np.abs(on_board[..., 1] - left) + np.abs(on_board[..., 2] - up) < 0.6
    points = np.where(hit[..., None], on_board, 2.0 * on_board).reshape(-1, 3)
    ring = np.repeat(np.arange(16, dtype=np.uint16), azimuth.shape[1])
    return Sweep(
        stamp_ns=number * 100_000_000,
        xyz=points.astype(np.float32),
        intensity=np.ones(len(points), np.float32),
        ring=ring,
        offset_ns=np.zeros(len(points), np.int64),
    )


if __name__ == "__main__":
    warm_up()
