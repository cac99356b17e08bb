"""Sweeps packed for browsers and programs, as :mod:`apexcal.documents.sweeps` lays them out."""

from __future__ import annotations

import zlib
from typing import Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.sweeps import POSITION_STEP_M, TIME_STEP_NS, SweepHeader
from workers.readers.recording import Sweep

_LARGEST: Final = 2**23 - 1
_GZIP: Final = 31  # zlib's window bits for a gzip member
_INTENSITIES: Final = 2**16 - 1
_FEW_INTENSITIES: Final = 2**8 - 1

Integers = NDArray[np.int32]


def pack(sweep: Sweep, index: int, ring_count: int) -> bytes:
    """A sweep's bytes over the wire.

    Positions are rounded to 1 mm and cut off at 8.3 km along each axis, times are rounded to 1 us.
    A position that is not finite becomes the origin. If all intensities
    are whole numbers up to 65535, they are kept. Otherwise they are rounded to 255 steps up to the largest.

    Args:
        sweep: its rings are below ``ring_count``.
        index: its number in the recording.
        ring_count: rings of the sensor.
    """
    order = np.argsort(sweep.ring, kind="stable")
    # The layout has no word for a position that is none; sensors write the origin for it.
    metres = np.nan_to_num(sweep.xyz[order].astype(np.float64), nan=0.0, posinf=0.0, neginf=0.0)
    steps = np.rint(metres * (1.0 / POSITION_STEP_M))
    positions = np.clip(steps, -_LARGEST, _LARGEST).astype(np.int32)
    times = np.rint(sweep.offset_ns[order] * (1.0 / TIME_STEP_NS)).astype(np.int32)
    intensities, intensity_step = _intensities(sweep.intensity[order])
    header = SweepHeader(ring_count, len(order), index, sweep.stamp_ns, intensity_step=intensity_step)
    # 63,535 points of an OS1-64: run lengths 4.4 ms and 232 kB, level 1 7.5 ms and 237 kB, level 6 36 ms and 225 kB.
    compressor = zlib.compressobj(1, zlib.DEFLATED, _GZIP, 9, zlib.Z_RLE)
    parts = (
        header.pack(),
        np.bincount(sweep.ring, minlength=ring_count).astype("<u4").tobytes(),
        *(_planes(_folded(positions[:, axis]), 3) for axis in range(3)),
        _planes(intensities, 2),
        _planes(_folded(times), 3),
    )
    return b"".join([*(compressor.compress(part) for part in parts), compressor.flush()])


def _intensities(intensity: NDArray[np.float32]) -> tuple[NDArray[np.uint32], float]:
    """Intensities as numbers of steps, and the step. Negative values and NaN become 0."""
    finite = np.maximum(np.nan_to_num(intensity, nan=0.0, posinf=0.0, neginf=0.0), 0.0)
    largest = float(finite.max(initial=0.0))
    whole = np.rint(finite)
    if largest <= _INTENSITIES and np.array_equal(whole, finite):
        return whole.astype(np.uint32), 1.0
    step = largest / _FEW_INTENSITIES
    return np.rint(finite.astype(np.float64) / step).astype(np.uint32), step


def _folded(values: Integers) -> NDArray[np.uint32]:
    """(N,) first differences modulo 2^24, folded so that small ones of either sign give small numbers."""
    differences = np.diff(values, prepend=np.int32(0))
    signed = (differences << 8) >> 8
    return ((signed << 1) ^ (signed >> 31)).view(np.uint32)


def _planes(values: NDArray[np.uint32], count: int) -> bytes:
    """The lowest ``count`` bytes of each value, as planes: all lowest bytes, then all next ones."""
    return values.astype("<u4").view(np.uint8).reshape(-1, 4)[:, :count].T.tobytes()
