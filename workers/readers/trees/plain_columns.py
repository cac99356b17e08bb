"""Columns of a table of points that names none: how many a row has, and what each holds, by their content."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from workers.readers.clouds.ring_spread import check_rings
from workers.readers.recording import ReadError

_WIDTHS: Final = range(3, 9)
_USUAL_WIDTH: Final = 4
_BINS: Final = 64
_MOST_VALUES: Final = 400_000
# Bits by which a column is told from its neighbours. An estimate from 1,000 values is 0.05 bits off.
_CLEAR_BITS: Final = 0.05
# Angle between lasers that fire together, as a share of that between any two. Some sensors' stand some degrees apart.
_SAME_WAY: Final = 0.1
_FARTHEST_M: Final = 2000.0
_MOST_RINGS: Final = 256
_IN_ORDER: Final = 0.9

Table = NDArray[np.floating[Any]]


@np.errstate(invalid="ignore", over="ignore")
def width_of(values: NDArray[np.float32], sizes: Sequence[int]) -> int | None:
    """Return the number of columns of rows of float32 that follow each other; None where no number fits the files.

    A column's values spread less than those of several columns mixed: the mean entropy of the columns is least at the
    right width, and at its multiples, because entropy is concave (Cover and Thomas, Elements of Information Theory,
    2.7.3).

    Args:
        values: (M,) of whole files, one after the other.
        sizes: of each file, the number of values.
    """
    widths = [width for width in _WIDTHS if all(size % width == 0 for size in sizes)]
    some = values[: _MOST_VALUES - _MOST_VALUES % 840]  # 840 is a multiple of all widths
    some = np.where(np.isfinite(some), some, np.float32(_FARTHEST_M))
    if not widths or not len(some):
        return _USUAL_WIDTH if _USUAL_WIDTH in widths else next(iter(widths), None)
    edges = np.unique(np.quantile(some, np.linspace(0, 1, _BINS + 1)))
    bins = np.searchsorted(edges, some, side="right")
    entropy = {width: _entropy(bins[: len(bins) - len(bins) % width].reshape(-1, width)) for width in widths}
    least = min(entropy.values())
    if max(entropy.values()) - least < _CLEAR_BITS and _USUAL_WIDTH in widths:
        return _USUAL_WIDTH
    best = next(width for width in widths if entropy[width] < least + _CLEAR_BITS)
    smaller = (width for width in widths if width < best and best % width == 0)
    return next((width for width in smaller if _are_points(values, width, best)), best)


def _are_points(values: NDArray[np.float32], width: int, several: int) -> bool:
    """Whether rows of ``several`` columns are points of ``width`` each, of lasers that fire in turn below and above.

    Then z splits, but lasers that fire together look the same way in x and y; other columns look no way.
    """
    rows = values[: min(len(values), _MOST_VALUES) // several * several].reshape(-1, several).astype(np.float64)
    first, second = rows[:, 0] + 1j * rows[:, 1], rows[:, width] + 1j * rows[:, width + 1]
    is_return = np.isfinite(first) & np.isfinite(second) & (first != 0) & (second != 0)
    first, second = first[is_return], second[is_return]
    if not len(first):
        return False
    others = np.random.default_rng(0).permutation(second)
    apart, usual = (float(np.median(np.abs(np.angle(first * ways.conj())))) for ways in (second, others))
    return apart < _SAME_WAY * usual


def _entropy(bins: NDArray[np.int64]) -> float:
    """Mean over the columns of their entropy in bits, with the correction of Miller and Madow (1955)."""
    bits = 0.0
    for column in bins.T:
        counts = np.bincount(column)
        share = counts[counts > 0] / len(column)
        bits += float(-(share * np.log2(share)).sum()) + (len(share) - 1) / (2 * len(column) * np.log(2))
    return bits / bins.shape[1]


@np.errstate(invalid="ignore")
def are_coordinates(xyz: Table) -> bool:
    """Whether nearly all values may be metres from a sensor, or mark a missing return."""
    return not len(xyz) or float(np.mean((np.abs(xyz) < _FARTHEST_M) | ~np.isfinite(xyz))) >= 0.99


@np.errstate(invalid="ignore", over="ignore")
def name_columns(table: Table, *, is_free: bool = False) -> list[str] | None:
    """Return a name for each column (N, M): x, y, z, intensity, ring, time, or ``column_5`` of what is none.

    Args:
        table: x, y and z come first, and intensity fourth.
        is_free: it may begin with a time or a number instead, and the fourth column may be another one.

    Returns:
        None where the content of a free order does not tell which columns are the coordinates.
    """
    table = table[: _MOST_VALUES // table.shape[1]]
    x = 1 if is_free and table.shape[1] > 3 and (_is_whole(table[:, 0]) or _is_in_order(table[:, 0])) else 0
    xyz = table[:, x : x + 3].astype(np.float32)
    free = [index for index in range(table.shape[1]) if not x <= index < x + 3]
    if is_free and (
        not are_coordinates(xyz) or any(_is_whole(axis) for axis in xyz.T) or bool((table[:, free] < 0).any())
    ):
        return None
    names = [f"column_{index + 1}" for index in range(table.shape[1])]
    names[x : x + 3] = "xyz"
    others = [index for index in free if index != 3 or is_free]
    ring = next((index for index in others if _are_rings(xyz, table[:, index])), None)
    time = next((index for index in others if index != ring and _is_in_order(table[:, index])), None)
    intensity = next((index for index in free if index not in (ring, time)), None)
    for index, name in ((ring, "ring"), (time, "time"), (intensity, "intensity")):
        if index is not None:
            names[index] = name
    return names


def _is_whole(column: Table) -> bool:
    values = column[np.isfinite(column)]
    return bool(np.all(values == np.rint(values))) and bool(np.all(values >= 0))


def _is_in_order(column: Table) -> bool:
    """Whether values rise from point to point, as times do; within each ring of a file that lists ring after ring."""
    steps = np.diff(column)
    return len(steps) > 0 and float(np.mean(steps >= 0)) > _IN_ORDER and bool((steps > 0).any())


def _are_rings(xyz: NDArray[np.float32], column: Table) -> bool:
    is_return = np.isfinite(xyz).all(axis=1) & xyz.any(axis=1) & np.isfinite(column)
    values = column[is_return]
    if not len(values) or not _is_whole(values) or values.max() >= 2**16:
        return False
    if not 1 < len(np.unique(values)) <= min(_MOST_RINGS, max(2, len(values) // 4)):
        return False
    try:
        check_rings([(xyz[is_return], values.astype(np.int64))], "", "")
    except ReadError:
        return False
    return True
