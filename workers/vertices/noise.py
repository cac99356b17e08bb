"""How far vertices lie from the apex, in the sensor's own axes: azimuth, elevation, range."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.vertices.vertex import Vertex

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class _Noise:
    """Standard deviations in degrees, degrees and metres: of each vertex by itself, and of what is common."""

    own: tuple[float, float, float]
    common: tuple[float, float, float]


# What was measured on simulated walks (VLP-16, 900 and 330 vertices). The rules of the top ring put every vertex too
# low, by 0.09 degrees (strict) and by 0.14 to 0.19 (tolerant): neighbours have that in common.
_BY_DETECTOR: Final = {
    "strict": _Noise(own=(0.047, 0.045, 0.008), common=(0.0, 0.1, 0.0)),
    "tolerant": _Noise(own=(0.047, 0.09, 0.008), common=(0.0, 0.18, 0.0)),
}
_UNKNOWN: Final = _BY_DETECTOR["tolerant"]
# Share of a stated variance that lasts for some sweeps: what `refined` knows of the board's roll it knows from the
# sweeps before and after, and the roll's error moves the apex in azimuth. Measured on simulated walks over 4-32 m:
# neighbours' errors in azimuth correlate by 0.43, 0.32, 0.20 one, two and three sweeps apart, those in elevation and
# range by less than 0.1.
_LASTING: Final = (0.4, 0.0, 0.0)
LASTING_S: Final = 0.3


def noise_of(vertices: Sequence[Vertex]) -> tuple[Floats, Floats, Floats]:
    """The errors of N vertices over (azimuth rad, elevation rad, range m).

    Returns:
        (N, 3, 3) covariance of each vertex about what neighbours have in common; (N, 3) standard deviation of what
        they have in common; (N, 3) share of the variance that lasts, with a correlation of exp(-dt / LASTING_S).
    """
    own, common, lasting = np.zeros((len(vertices), 3, 3)), np.zeros((len(vertices), 3)), np.zeros((len(vertices), 3))
    for i, vertex in enumerate(vertices):
        if vertex.covariance is not None:
            own[i] = vertex.covariance
            lasting[i] = _LASTING
            continue
        noise = _BY_DETECTOR.get(vertex.detector, _UNKNOWN)
        own[i] = np.diag(_radians(noise.own) ** 2)
        common[i] = _radians(noise.common)
    return own, common, lasting


def _radians(sigma: tuple[float, float, float]) -> Floats:
    return np.array([np.radians(sigma[0]), np.radians(sigma[1]), sigma[2]])
