"""A spinning LiDAR with errors that its maker's table does not say, mounted otherwise than level."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workers.simulation.beams import BOARD
from workers.simulation.lidar import SimulatedLidar, directions
from workers.simulation.scene import Scene
from workers.simulation.sensors import LidarModel
from workers.simulation.walker import Poses

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


class FlawedLidar(SimulatedLidar):
    """The simulator's LiDAR, with flaws and a mount; its sweeps may begin anywhere.

    Without these it is the simulator's own, to the bit.
    """

    def __init__(
        self,
        sensor: LidarModel,
        scene: Scene,
        walk: Any,
        *,
        seed: int,
        flaws: Flaws | None = None,
        mount: Mount | None = None,
        **options: Any,
    ) -> None:
        super().__init__(sensor, scene, walk, seed=seed, **options)
        self._flaws, self._mount = flaws or Flaws(), mount or Mount()
        self.mixing = (self._flaws.mixing_m, self._flaws.least_share)
        rings = len(sensor.elevations_deg)
        random = np.random.default_rng([seed, 10])
        angle = math.radians(self._flaws.ring_angle_deg)
        self._bias_m = random.normal(0.0, self._flaws.ring_bias_m, rings)
        self._up_error, self._aside_error = random.normal(0.0, angle, (2, rings))
        self._wander = random.uniform(0.0, 2.0 * math.pi, 3)
        self._begins = self._sector if self._mount.seam_deg is None else math.radians(self._mount.seam_deg)

    def _columns_s(self, late: float) -> Floats:
        if self._mount.seam_deg is None:
            return super()._columns_s(late)
        step = math.radians(self.sensor.step_deg)
        turn = (np.arange(int(2.0 * math.pi / step) - 1, dtype=np.float64) + late) * step
        ahead = np.abs(np.remainder(self._begins - turn + math.pi, 2.0 * math.pi) - math.pi) < self._sector
        return turn[ahead] / self._omega

    def _turned(self, start_s: float, column_s: Floats) -> Floats:
        """The motor wanders slowly, once and seven times a turn."""
        rates_hz = np.array([0.3, self.sensor.rate_hz, 7.0 * self.sensor.rate_hz])
        time_s = start_s + column_s
        waves = np.sin(2.0 * math.pi * time_s[:, None] * rates_hz + self._wander) @ np.array([0.4, 0.3, 0.3])
        return self._begins - self._omega * column_s + math.radians(self._flaws.wander_deg) * waves

    def _encoded(self, turned: Floats, random: np.random.Generator) -> Floats:
        return turned + random.normal(0.0, 1e-3 * self._flaws.jitter_mrad, len(turned))

    def _level(self, turned: Floats) -> tuple[Floats, Floats]:
        azimuth = turned[:, None] - (self._omega * self.delay_s - self._aside - self._aside_error)
        elevation = np.broadcast_to(self._elevations + self._up_error, azimuth.shape)
        if self._mount.roll_deg == 0.0 and self._mount.pitch_deg == 0.0:
            return azimuth, np.ascontiguousarray(elevation)
        x, y, z = np.moveaxis(directions(azimuth, elevation) @ self._mount.rotation().T, -1, 0)
        return np.arctan2(y, x), np.arcsin(np.clip(z, -1.0, 1.0))

    def _range_error(
        self, index: int, distance: Floats, surface: NDArray[np.int64], reflectance: Floats, azimuth: Floats,
        elevation: Floats, poses: Poses,
    ) -> Floats:  # fmt: skip
        flaws = self._flaws
        cosine = np.ones(distance.shape)
        column, ring = np.nonzero(surface == BOARD)
        if column.size:
            normal = np.cross(poses.edge_left, poses.edge_right)[column]
            beam = directions(azimuth[column, ring], elevation[column, ring])
            cosine[column, ring] = np.abs(np.sum(normal * beam, axis=1))
        if flaws.lost_share > 0.0:
            chance = np.random.default_rng([self._seed, 11, index]).uniform(size=distance.shape)
            distance[lost(flaws, reflectance, cosine, chance)] = np.inf
        return range_error(flaws, self._bias_m[None, :], reflectance, cosine)

    def scan_seconds(self, azimuth: Floats) -> Floats:
        """Seconds after a sweep's start at which the sensor looks along ``azimuth`` (radians, its own frame)."""
        turned = self._begins - azimuth
        return (turned if self._mount.seam_deg is None else np.remainder(turned, 2.0 * math.pi)) / self._omega

    def in_sensor_frame(self, points: Floats) -> Floats:
        """Points (N, 3) of the scene's level frame in the sensor's own, metres."""
        return points @ self._mount.rotation()
