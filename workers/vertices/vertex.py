"""A detector's answers: a vertex with its errors, or the reason why there is none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from apexcal.documents.corners import CornerName
from apexcal.documents.detectors import Quality

Floats = NDArray[np.float64]
Xyz = tuple[float, float, float]
Covariance = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]


@dataclass(frozen=True, slots=True)
class Corners:
    """The board's corners besides its apex, at the moment of the apex.

    Attributes:
        names: which they are.
        xyz: metres, LiDAR frame.
        covariance: of the apex and of each of them, over (azimuth rad, elevation rad, range m) each: a symmetric
            matrix of 3 (1 + corners) rows.
    """

    names: tuple[CornerName, ...]
    xyz: tuple[Xyz, ...]
    covariance: tuple[tuple[float, ...], ...]

    @classmethod
    def of(cls, names: Sequence[CornerName], xyz: ArrayLike, covariance: ArrayLike) -> Self:
        """Return corners from arrays of these shapes."""
        joint = np.asarray(covariance, np.float64)
        joint = 0.5 * (joint + joint.T)
        places = [(x, y, z) for x, y, z in np.asarray(xyz, np.float64).tolist()]
        return cls(tuple(names), tuple(places), tuple(tuple(line) for line in joint.tolist()))


@dataclass(frozen=True, slots=True)
class Vertex:
    """The board's apex as one sweep saw it.

    Attributes:
        xyz: metres, LiDAR frame.
        time_ns: UTC nanoseconds, when the vertex point itself was measured (mean where there are several).
        ring: ring of the vertex point, 0 the lowest; if the apex lies between rings, the highest ring on the board.
        sweep_index: index of the sweep in its recording.
        points_used: how many points were averaged, or lie on the board.
        detector: name in ``detectors.DETECTORS``.
        covariance: of (azimuth rad, elevation rad, range m) of the apex in the LiDAR frame; None if the detector
            states none. Azimuth is atan2(y, x), elevation atan2(z, hypot(x, y)), range the Euclidean distance.
        quality: ``fine`` or ``usable``; None if the detector does not grade.
        flags: names in :data:`apexcal.documents.detectors.FLAGS`, for the person who confirms.
        roll: radians by which the board is turned, counter-clockwise as the sensor sees it, and its standard
            deviation; at 0 both upper edges fall alike. None if the detector states none.
        corners: those that are known well enough; None if there are none, or the board's size is unknown.
    """

    xyz: Xyz
    time_ns: int
    ring: int
    sweep_index: int
    points_used: int
    detector: str
    covariance: Covariance | None = None
    quality: Quality | None = None
    flags: tuple[str, ...] = ()
    roll: tuple[float, float] | None = None
    corners: Corners | None = None


@dataclass(frozen=True, slots=True)
class Rejection:
    """Why a sweep has no vertex: one of its detector's ``reasons``, an example in figures, and its points."""

    reason: str
    example: str = ""
    points: int = 0


@dataclass(frozen=True, slots=True)
class PoseFacts:
    """The number of a recording's still poses, and whether its owner stated them (otherwise its sweeps showed them).

    Attributes:
        walked: the owner stated it, but something in the recording moves as a person who walks.
    """

    count: int
    stated: bool
    walked: bool = False


@dataclass(frozen=True, slots=True)
class SizeFacts:
    """The board's size as its near sweeps show it.

    Attributes:
        seen_m: its edges, the shorter one first.
        sigma_m: their standard deviations.
        contradicts: whether the boards disagree with the stated size, if edges bloom as usual.
        replaces: whether no blooming explains the stated size; then vertices use the size that the boards show.
    """

    seen_m: tuple[float, float]
    sigma_m: tuple[float, float]
    contradicts: bool = False
    replaces: bool = False


@dataclass(frozen=True, slots=True)
class Answers:
    """A detector's outcomes for a range of sweeps, in their order, and the board's size.

    Attributes:
        size: as the boards show it; None if they do not.
    """

    outcomes: Sequence[Vertex | Rejection]
    size: SizeFacts | None = None


@dataclass(frozen=True, slots=True)
class Detections:
    """The vertices of a range of sweeps in sweep order, and why its other sweeps have none.

    Attributes:
        vertices: of the requested sweeps.
        frames: how many sweeps were requested.
        rejected: number of sweeps by reason.
        context: vertices of some sweeps before and after, in sweep order, so that a track can be interpolated up to
            the range's ends.
        refused: reason of each sweep without a vertex, by the sweep's index, in sweep order.
        poses: of a recording of still poses, whose vertices form no track; else None.
        size: as the boards show it; None if they do not.
        examples: what one sweep shows, by reason.
    """

    vertices: list[Vertex]
    frames: int
    rejected: dict[str, int]
    context: tuple[Vertex, ...] = ()
    refused: Mapping[int, str] = field(default_factory=dict[int, str])
    poses: PoseFacts | None = None
    size: SizeFacts | None = None
    examples: Mapping[str, str] = field(default_factory=dict[str, str])


@dataclass(frozen=True, slots=True)
class _Noise:
    """Standard deviations in degrees, degrees and metres: of each vertex by itself, and of what neighbours share."""

    own: tuple[float, float, float]
    common: tuple[float, float, float]


# Measured on simulated walks (VLP-16, 900 and 330 vertices). The rules of the top ring place every vertex too low, by
# 0.09 degrees (strict) and by 0.14 to 0.19 (tolerant): neighbours share that error.
_BY_DETECTOR: Final = {
    "strict": _Noise(own=(0.047, 0.045, 0.008), common=(0.0, 0.1, 0.0)),
    "tolerant": _Noise(own=(0.047, 0.09, 0.008), common=(0.0, 0.18, 0.0)),
}
_UNKNOWN: Final = _BY_DETECTOR["tolerant"]
# Share of a stated variance that lasts for some sweeps. `refined` takes the board's roll partly from the sweeps
# before and after, and an error of the roll moves the apex in azimuth. Measured on simulated walks over 4-32 m:
# neighbours' errors in azimuth correlate by 0.43, 0.32, 0.20 one, two and three sweeps apart, those in elevation and
# range by less than 0.1.
_LASTING: Final = (0.4, 0.0, 0.0)
LASTING_S: Final = 0.3


def noise_of(vertices: Sequence[Vertex]) -> tuple[Floats, Floats, Floats]:
    """Return the errors of N vertices over (azimuth rad, elevation rad, range m).

    Returns:
        (N, 3, 3) covariance of each vertex without what neighbours share; (N, 3) standard deviation of what they
        share; (N, 3) share of the variance that lasts, with a correlation of exp(-dt / LASTING_S).
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


def spread_order(count: int) -> list[int]:
    """Return the rank of each of ``count`` vertices in time order: van der Corput's sequence in base 2.

    If marking stops early, the marked vertices are then spread over the whole walk, near and far, left and right.
    """
    bits = max(count - 1, 1).bit_length()
    reversed_bits = [int(f"{index:0{bits}b}"[::-1], 2) for index in range(count)]
    rank_of = {value: rank for rank, value in enumerate(sorted(reversed_bits))}
    return [rank_of[value] for value in reversed_bits]
