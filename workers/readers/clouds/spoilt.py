"""Clouds whose bytes were misread: of another byte order or layout than the others of their topic.

Floating point numbers with misplaced bytes are near 0 or beyond any distance, so such a cloud is told by its scale.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.readers.recording import MessageError

# Walks from a wall to a field change the median range by far less, misplaced bytes by far more.
_FACTOR: Final = 1000.0
_PROBES: Final = 64


def scale_of(xyz: NDArray[np.float32]) -> float:
    """Median of the sum of coordinates of some of the points (N, 3), metres, N at least 1."""
    some = np.abs(xyz[:: max(1, len(xyz) // _PROBES)].astype(np.float64)).sum(axis=1)
    return float(np.sort(some)[len(some) // 2])


def usual_scale(clouds: Sequence[NDArray[np.float32]]) -> float:
    """The median scale of several clouds, metres."""
    return float(np.median([scale_of(xyz) for xyz in clouds]))


def is_of_scale(xyz: NDArray[np.float32], usual_m: float) -> bool:
    """Whether points (N, 3) lie about as far away as the others' do."""
    return usual_m / _FACTOR <= scale_of(xyz) <= usual_m * _FACTOR


def check_scale(xyz: NDArray[np.float32], usual_m: float, where: str) -> None:
    """Refuse a cloud whose points lie at quite another distance than the others' do.

    Raises:
        MessageError: ``cloud_malformed``.
    """
    if is_of_scale(xyz, usual_m):
        return
    raise MessageError(
        "cloud_malformed",
        f"{where} has coordinates of {scale_of(xyz):.3g} m, where the others have some of {usual_m:.3g} m.",
        "Its layout or byte order may be misstated: look at the program that wrote it.",
    )
