"""A spinning LiDAR: where each beam of a sweep ends, and when it was fired.

Rings are numbered by elevation, 0 the lowest. The sensor turns clockwise seen from above (azimuth
atan2(y, x) falls with time), and each point carries its own time, as a VLP-16's does.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.simulation import Disturbances
from workers.readers.recording import Sweep
from workers.simulation.beams import SPECKLE, cast
from workers.simulation.scene import Scene
from workers.simulation.sensors import LidarModel
from workers.simulation.walker import BodyPoses, Poses

# Mean intensity of each surface: of nothing, then from GROUND to BOX.
_INTENSITY = np.array([0.0, 12.0, 45.0, 80.0, 190.0, 28.0, 28.0, 4.0, 60.0])
_RANGE_STEP_M = 0.002  # the resolution of a VLP-16's range
_FIRING_S = 2.304e-6  # one laser after the other
_SPECKLE_M = (1.0, 2.5)  # nearest, and mean distance beyond that

Floats = NDArray[np.float64]


class Walks(Protocol):
    """The places of board and people at any moments."""

    def poses(self, time_s: NDArray[np.float64]) -> Poses: ...


class SimulatedLidar:
    """Scans the scene with the walker in it, over a forward sector of +- ``sector_deg``.

    Attributes:
        columns: how many times all lasers are fired in a sweep.
        firing: (R,) position of each ring's laser in the firing order of a column, 0 first.
        delay_s: (R,) seconds from the start of a column to each ring's firing.
        mixing: surfaces that lie less than this far apart (metres) along a beam give one return, at their mean range;
            and the share of the beam that a surface needs to answer.
    """

    mixing: tuple[float, float] = (0.0, 0.0)

    def __init__(
        self,
        sensor: LidarModel,
        scene: Scene,
        walk: Walks,
        *,
        sector_deg: float,
        noise_m: float,
        seed: int,
        disturbances: Disturbances | None = None,
    ) -> None:
        self.sensor = sensor
        self._scene = scene
        self._walk = walk
        self._noise_m = noise_m
        self._seed = seed
        self._disturbances = disturbances or Disturbances()
        # One column less than fits: the grid starts by up to a step late, and a column takes its time.
        self.columns = int(2.0 * sector_deg / sensor.step_deg) - 1
        self._sector = math.radians(sector_deg)
        self._omega = 2.0 * math.pi * sensor.rate_hz  # radians per second
        rings = len(sensor.elevations_deg)
        half = (rings + 1) // 2
        ring = np.arange(rings)
        self.firing = np.where(ring < half, 2 * ring, 2 * (ring - half) + 1)  # interleaved, as the VLP-16 does
        self.delay_s = self.firing * min(_FIRING_S, math.radians(sensor.step_deg) / self._omega / rings)
        self._elevations = np.deg2rad(np.array(sensor.elevations_deg))
        self._lift_m = -sensor.lens_m * np.tan(self._elevations)
        self._aside = np.deg2rad(np.array(sensor.azimuths_deg)) if sensor.azimuths_deg else np.zeros(rings)
        self._every = np.array(sensor.every) if sensor.every else np.ones(rings, np.int64)

    def seconds_per_sector(self) -> float:
        """Return the seconds from a sweep's stamp to its last point."""
        return 2.0 * self._sector / self._omega

    def sweep(self, index: int, start_s: float, stamp_ns: int) -> Sweep:
        """The sweep whose first column is fired at ``start_s`` (seconds since the start of the walk).

        The azimuth grid starts anew in each sweep by a random part of a step, as a free-running motor's
        does. Depends on (seed, index) alone.
        """
        return self.labelled_sweep(index, start_s, stamp_ns)[0]

    def labelled_sweep(self, index: int, start_s: float, stamp_ns: int) -> tuple[Sweep, NDArray[np.int64]]:
        """The sweep, and (N,) what each of its points lies on, as :mod:`.beams` numbers surfaces."""
        random = np.random.default_rng([self._seed, 2, index])
        column_s = self._columns_s(random.uniform())
        poses = self._walk.poses(start_s + column_s)
        turned = self._turned(start_s, column_s)
        azimuth, elevation = self._level(turned)
        distance, surface = self._beams(azimuth, elevation, self._fired(column_s), poses)
        self._spoil(index, distance, surface)
        noise = random.normal(0.0, self._noise_m, distance.shape)
        reflectance = _INTENSITY[surface] / 255.0 * random.uniform(0.8, 1.2, distance.shape)
        error = self._range_error(index, distance, surface, reflectance, azimuth, elevation, poses)
        noisy = np.round((distance + noise + error) / _RANGE_STEP_M) * _RANGE_STEP_M
        column, ring = np.nonzero(distance <= self.sensor.max_range_m)
        after_s = column_s[column] + self.delay_s[ring]
        encoder = self._encoded(turned, random)
        xyz = directions(
            encoder[column] - self._omega * self.delay_s[ring] + self._aside[ring], self._elevations[ring]
        )
        xyz *= noisy[column, ring][:, None]
        xyz[:, 2] += self._lift_m[ring]
        sweep = Sweep(
            stamp_ns=stamp_ns,
            xyz=xyz.astype(np.float32),
            intensity=(255.0 * reflectance[column, ring]).astype(np.float32),
            ring=ring.astype(np.uint16),
            offset_ns=np.round(after_s * 1e9).astype(np.int64),
            time_source="per_point",
        )
        return sweep, surface[column, ring]

    def _columns_s(self, late: float) -> Floats:
        """When the columns that look into the sector are fired, seconds; the first is ``late`` steps late."""
        return (np.arange(self.columns, dtype=np.float64) + late) * math.radians(self.sensor.step_deg) / self._omega

    def _turned(self, start_s: float, column_s: Floats) -> Floats:
        """Return the motor's angle, radians, at each column of a sweep that starts at ``start_s``."""
        return self._sector - self._omega * column_s

    def _encoded(self, turned: Floats, random: np.random.Generator) -> Floats:
        """Return the encoder's reading of the motor's angle, radians."""
        return turned

    def _fired(self, column_s: Floats) -> NDArray[np.bool_]:
        """(C, R) which lasers fire in which columns."""
        number = np.floor(column_s * self._omega / math.radians(self.sensor.step_deg)).astype(np.int64)
        return number[:, None] % self._every == 0

    def _level(self, turned: Floats) -> tuple[Floats, Floats]:
        """Azimuth and elevation (C, R) of the beams in the scene's level frame, radians."""
        azimuth = turned[:, None] - (self._omega * self.delay_s - self._aside)
        return azimuth, np.ascontiguousarray(np.broadcast_to(self._elevations, azimuth.shape))

    def _beams(
        self, azimuth: Floats, elevation: Floats, fired: NDArray[np.bool_], poses: Poses
    ) -> tuple[Floats, NDArray[np.int64]]:
        """Range (C, R), infinite where nothing is met, and surface (C, R) of the beams of C columns."""
        scene = self._scene
        top = scene.ground_z + scene.wall_height
        walker = BodyPoses(poses.body, poses.left, poses.height, poses.torso_m)
        people = [walker, *([poses.second] if poses.second is not None else []), *poses.others]
        return cast(
            azimuth,
            elevation,
            self._lift_m,
            fired,
            np.array([0.5e-3 * self._disturbances.beam_mrad, *self.mixing]),
            np.stack([poses.apex, poses.edge_left, poses.edge_right], axis=1),
            np.stack([_rows(person) for person in people]),
            np.empty((len(azimuth), 0, 4)) if poses.hands is None else poses.hands,
            np.array(poses.board_m),
            np.array([scene.ground_z, scene.wall_x, scene.wall_half_width, top]),
            scene.poles,
            scene.boxes,
        )

    def _range_error(
        self, index: int, distance: Floats, surface: NDArray[np.int64], reflectance: Floats, azimuth: Floats,
        elevation: Floats, poses: Poses,
    ) -> Floats | float:  # fmt: skip
        """Systematic errors of the ranges (C, R), metres; returns that get lost become infinite in ``distance``."""
        return 0.0

    def _spoil(self, index: int, distance: NDArray[np.float64], surface: NDArray[np.int64]) -> None:
        """Specks in the air before what the beams would meet, then returns that are lost; in place."""
        speckle, dropout = self._disturbances.speckle, self._disturbances.dropouts
        random = np.random.default_rng([self._seed, 7, index])
        if speckle > 0.0:
            near = _SPECKLE_M[0] + random.exponential(_SPECKLE_M[1], distance.shape)
            met = (random.uniform(size=distance.shape) < speckle) & (near < distance)
            distance[met], surface[met] = near[met], SPECKLE
        if dropout > 0.0:
            distance[random.uniform(size=distance.shape) < dropout] = np.inf

    def scan_seconds(self, azimuth: Floats) -> Floats:
        """Seconds after a sweep's start at which the sensor looks along ``azimuth`` (radians, its own frame)."""
        return (self._sector - azimuth) / self._omega


def _rows(person: BodyPoses) -> Floats:
    torso = np.full(len(person.height), person.torso_m)
    return np.column_stack([person.body, person.left, person.height, torso])


def directions(azimuth: Floats, elevation: Floats) -> Floats:
    """Unit vectors (..., 3) along azimuths and elevations, radians."""
    flat = np.cos(elevation)
    return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], axis=-1)
