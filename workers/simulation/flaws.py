"""What a sensor does that its maker's table does not say, and how it is mounted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Flaws:
    """Errors of one sensor; the defaults change nothing. Standard deviations unless said otherwise.

    Attributes:
        ring_bias_m: of the constant error of each ring's ranges.
        ring_angle_deg: of each laser's elevation, and of its azimuth, about what the decoder takes them to be.
        intensity_m: how much longer a range is on black than on white; negative: shorter.
        incidence_m: how much longer a range is on a surface that is met at 60 degrees from its normal.
        mixing_m: surfaces that lie less than this far apart along a beam give one return, at their mean range.
        least_share: share of the beam that a surface needs to answer.
        lost_share: share of the returns that black, or white met at 75 degrees from its normal, does not give.
        wander_deg: amplitude of the motor's departures from even steps; the encoder sees them.
        jitter_mrad: of what the encoder says of each column.
    """

    ring_bias_m: float = 0.0
    ring_angle_deg: float = 0.0
    intensity_m: float = 0.0
    incidence_m: float = 0.0
    mixing_m: float = 0.0
    least_share: float = 0.0
    lost_share: float = 0.0
    wander_deg: float = 0.0
    jitter_mrad: float = 0.0


@dataclass(frozen=True, slots=True)
class Mount:
    """How a sensor stands on the vehicle.

    Attributes:
        roll_deg: about its x axis, positive: its left side is up; 180: upside down.
        pitch_deg: about its y axis after that, positive: it looks down.
        seam_deg: azimuth at which its sweeps begin; None: where its sector begins.
    """

    roll_deg: float = 0.0
    pitch_deg: float = 0.0
    seam_deg: float | None = None

    def rotation(self) -> Floats:
        """R_level_lidar (3, 3): directions of the sensor in the level frame of the scene, Ry(pitch) Rx(roll)."""
        roll, pitch = np.deg2rad([self.roll_deg, self.pitch_deg])
        cr, sr, cp, sp = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
        about_x = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
        about_y = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
        return about_y @ about_x


def range_error(flaws: Flaws, bias: Floats, reflectance: Floats, cosine: Floats) -> Floats:
    """Systematic error of ranges, metres.

    Args:
        bias: of each return's ring, metres.
        reflectance: of what it met, 0 (black) to 1 (white).
        cosine: of the angle between beam and normal; 1 where that is not known.

    Returns:
        Of the same shape. The pulse of a dark surface is late, and a slanted surface lengthens the pulse as
        1 / cosine: 1 / cos(60 degrees) - 1 = 1.
    """
    slanted = 1.0 / np.maximum(cosine, 0.2) - 1.0
    return bias + flaws.intensity_m * (0.5 - reflectance) + flaws.incidence_m * slanted


def lost(flaws: Flaws, reflectance: Floats, cosine: Floats, chance: Floats) -> NDArray[np.bool_]:
    """Which returns are too weak. A return's strength is reflectance x cosine (a Lambertian surface).

    ``chance``: uniform numbers of the same shape. Half of the strength of white at normal incidence always answers.
    """
    weakness = np.clip(1.0 - 2.0 * reflectance * cosine, 0.0, 1.0)
    return chance < flaws.lost_share * weakness
