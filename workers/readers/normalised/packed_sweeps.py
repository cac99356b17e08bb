"""Sweeps packed for workers, browsers and programs, as :mod:`apexcal.documents.sweeps` lays them out."""

from __future__ import annotations

from importlib import import_module
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.sweeps import (
    BYTES_PER_POINT,
    COARSE_STEP_M,
    HEADER_BYTES,
    POSITION_STEP_M,
    TIME_STEP_NS,
    SweepHeader,
)
from apexcal.sweeps import points_of
from workers.readers.recording import Sweep, TimeSource

_ISAL: Final[Any] = import_module("isal.isal_zlib")  # without types
_LARGEST: Final = 2**23 - 1
_GZIP: Final = 31  # zlib's window bits for a gzip member
# 63,603 points of an OS1-64: ISA-L's level 1 takes 1.0 ms and leaves 5.6 bytes a point, zlib's run lengths 4.4 ms
# and 5.4. It unpacks in 1.1 ms, zlib in 2.3.
_LEVEL: Final = 1
_INTENSITIES: Final = 2**16 - 1

Integers = NDArray[np.int32]


def pack(sweep: Sweep, ring_count: int) -> bytes:
    """A sweep's bytes in its sensor's file and over the wire.

    Positions are rounded to 0.1 mm, times to 1 us. If a point is farther than 838 m along an axis, the sweep's are
    rounded to 1 mm and cut off at 8.3 km. A position that is not finite becomes the origin. If all intensities
    are whole numbers up to 65535, they are kept. Otherwise they are rounded to 65535 steps up to the largest.

    Args:
        ring_count: rings of the sensor, more where the sweep has more.

    Raises:
        OverflowError: a point lies more than 8.3 s from its sweep's stamp.
    """
    order = np.argsort(sweep.ring, kind="stable")
    # The layout has no word for a position that is none; sensors write the origin for it.
    metres = sweep.xyz if np.isfinite(sweep.xyz).all() else np.nan_to_num(sweep.xyz, nan=0.0, posinf=0.0, neginf=0.0)
    reach = float(np.abs(metres).max(initial=0.0))
    step = POSITION_STEP_M if reach <= _LARGEST * POSITION_STEP_M else COARSE_STEP_M
    times = np.rint(sweep.offset_ns * (1.0 / TIME_STEP_NS))
    if np.abs(times).max(initial=0.0) > _LARGEST:
        raise OverflowError("a point lies more than 8.3 s from the stamp of its sweep")
    columns = np.empty((4, len(order)), np.int32)
    steps = np.rint(metres * np.float32(1.0 / step))
    if reach > _LARGEST * step:
        np.clip(steps, -_LARGEST, _LARGEST, out=steps)
    columns[:3] = steps.astype(np.int32)[order].T
    columns[3] = times.astype(np.int32)[order]
    folded = _planes(_folded(columns), 3)
    intensities, intensity_step = _intensities(sweep.intensity[order])
    counts = np.bincount(sweep.ring, minlength=ring_count).astype("<u4")
    header = SweepHeader(len(counts), len(order), step, intensity_step)
    parts = (header.pack(), counts.tobytes(), folded[:9], _planes(intensities[None], 2), folded[9:])
    compressor = _ISAL.compressobj(_LEVEL, _ISAL.DEFLATED, _GZIP)
    return b"".join([*(compressor.compress(part) for part in parts), compressor.flush()])


def unpacked(data: bytes, points: int, stamp_ns: int, time_source: TimeSource) -> Sweep:
    """A sweep back from :func:`pack`; every array is contiguous and its own.

    Args:
        points: how many it has: no more is unpacked.

    Raises:
        ValueError: other bytes.
    """
    most = HEADER_BYTES + 4 * 2**16 + BYTES_PER_POINT * points
    try:
        read = points_of(_ISAL.decompressobj(_GZIP).decompress(data, most))
    except _ISAL.error as error:
        raise ValueError(str(error)) from error
    return Sweep(stamp_ns, read.xyz, read.intensity, read.ring, read.offset_ns, time_source)


def _intensities(intensity: NDArray[np.float32]) -> tuple[NDArray[np.uint32], float]:
    """Intensities as numbers of steps, and the step. Negative values and NaN become 0."""
    finite = np.maximum(np.nan_to_num(intensity, nan=0.0, posinf=0.0, neginf=0.0), 0.0)
    largest = float(finite.max(initial=0.0))
    whole = np.rint(finite)
    if largest <= _INTENSITIES and np.array_equal(whole, finite):
        return whole.astype(np.uint32), 1.0
    step = largest / _INTENSITIES
    return np.rint(finite.astype(np.float64) / step).astype(np.uint32), step


def _folded(columns: Integers) -> NDArray[np.uint32]:
    """(C, N) first differences modulo 2^24, folded so that small ones of either sign give small numbers."""
    differences = np.diff(columns, prepend=np.int32(0))
    signed = (differences << 8) >> 8
    return ((signed << 1) ^ (signed >> 31)).view(np.uint32)


def _planes(columns: NDArray[np.uint32], count: int) -> NDArray[np.uint8]:
    """(C * count, N) the lowest ``count`` bytes of (C, N) values: of each column all lowest, then all next ones."""
    rows, values = columns.shape
    of_bytes = columns.astype("<u4", copy=False).view(np.uint8).reshape(rows, values, 4)
    return np.ascontiguousarray(of_bytes[..., :count].transpose(0, 2, 1)).reshape(rows * count, values)
