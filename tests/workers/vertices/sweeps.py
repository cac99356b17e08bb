"""Sweeps made by hand: a list of (ring, x, y, z) and a time for each point."""

import numpy as np

from workers.readers.recording import Sweep
from workers.vertices.region import Region

EVERYTHING = Region.from_document({"all": [{"quantity": "range", "op": ">", "value": 0}]})
IN_FRONT = Region.from_document({"all": [{"quantity": "x", "op": ">", "value": 0}]})


def sweep(points, *, stamp_ns=1_000_000_000, offset_ns=None):
    rows = np.array(points, np.float64).reshape(-1, 4)
    offsets = np.arange(len(rows)) * 1000 if offset_ns is None else np.array(offset_ns)
    return Sweep(
        stamp_ns=stamp_ns,
        xyz=rows[:, 1:].astype(np.float32),
        intensity=np.zeros(len(rows), np.float32),
        ring=rows[:, 0].astype(np.uint16),
        offset_ns=offsets.astype(np.int64),
    )


def row(ring, count, *, x=5.0, step=0.02, z=None):
    """``count`` points of one ring, ``step`` metres apart."""
    height = 0.1 * ring if z is None else z
    return [(ring, x, step * i, height) for i in range(count)]
