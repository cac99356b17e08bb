"""What a vehicle's LiDAR and camera record of a simulated road while it drives."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from tests.support.scenes.road import LIDAR_HEIGHT_M, Road
from tests.support.scenes.road_rays import cast_rays
from workers.geometry.projection import unproject
from workers.readers.recording import Sweep
from workers.simulation.camera import SimulatedCamera
from workers.simulation.sensors import LidarModel

Floats = NDArray[np.float64]

_OVERSAMPLE: Final = 2
# Of a full scale of 255: a marker returns 60 to 150 on the real sensors at hand, asphalt 10 to 50.
_INTENSITY: Final = 160.0
_HALF_SECTOR: Final = np.pi / 2
_BLUR_PX: Final = 0.7


@dataclass(frozen=True, slots=True)
class Drive:
    """How it is recorded.

    Attributes:
        speed_m_s: the vehicle's speed; points are measured while it moves, frames in an instant.
        noise_m: of a range; bias_m: from ring to ring.
        dropout: share of beams without a return.
        light: brightness of a white surface, grey levels; grain: noise of a pixel, grey levels.
        every_s: seconds between frames.
        turn_deg_s: how fast the vehicle turns left in each frame; it looks along the road there.
        ring_angle_deg: of each laser's elevation, and of its azimuth, about what the decoder takes them to be.
        beam_deg: how wide a beam is; the nearest surface that two of five rays in it meet answers.
    """

    speed_m_s: float = 8.0
    noise_m: float = 0.01
    bias_m: float = 0.01
    dropout: float = 0.02
    light: float = 220.0
    grain: float = 3.0
    every_s: float = 0.5
    turn_deg_s: float = 0.0
    ring_angle_deg: float = 0.0
    beam_deg: float = 0.0


def draw_drive(seed: int) -> Drive:
    """A drive drawn from wide ranges of speed, light and noise."""
    random = np.random.default_rng([seed, 22])
    return Drive(
        speed_m_s=random.uniform(0.0, 14.0),
        noise_m=random.uniform(0.005, 0.03),
        bias_m=random.uniform(0.0, 0.015),
        dropout=random.uniform(0.0, 0.08),
        light=random.uniform(120.0, 255.0),
        grain=random.uniform(1.0, 8.0),
    )


def draw_real_drive(seed: int, speed_m_s: float) -> Drive:
    """A drive whose sensor has the errors of real ones, in the ranges that drawn boards have; in curves it turns."""
    random = np.random.default_rng([seed, 25])
    return replace(
        draw_drive(seed),
        speed_m_s=speed_m_s,
        turn_deg_s=random.uniform(-1.0, 1.0) * min(15.0, 2.0 * speed_m_s),
        ring_angle_deg=random.uniform(0.0, 0.04),
        beam_deg=random.uniform(0.08, 0.2),  # data sheets: 0.09 to 0.18
    )


def record(
    road: Road, drive: Drive, sensor: LidarModel, camera: SimulatedCamera, seed: int, frames: int
) -> Iterator[tuple[Sweep, NDArray[np.uint8]]]:
    """Sweeps of the half turn ahead, each with the frame (h, w, 3) BGR of the moment when it looks ahead."""
    for sweep, _, image in record_pairs(road, drive, sensor, camera, seed, frames):
        yield sweep, image


def record_pairs(
    road: Road, drive: Drive, sensor: LidarModel, camera: SimulatedCamera, seed: int, frames: int
) -> Iterator[tuple[Sweep, Sweep, NDArray[np.uint8]]]:
    """As :func:`record`, with the sweep that follows each."""
    rays = _camera_rays(camera)
    bias = np.random.default_rng([seed, 23]).normal(0.0, 1.0, len(sensor.elevations_deg)) * drive.bias_m
    angles = np.random.default_rng([seed, 26]).normal(0.0, 1.0, (2, len(sensor.elevations_deg)))
    for number in range(frames):
        random = np.random.default_rng([seed, 24, number])
        at = np.array([drive.speed_m_s * drive.every_s * number, 0.0, LIDAR_HEIGHT_M])
        sweep = _sweep(road, drive, sensor, at, bias, angles, random)
        image = _frame(road, drive, camera, rays, at, random)
        yield sweep, _sweep(road, drive, sensor, at, bias, angles, random, 1.0 / sensor.rate_hz), image


def _sweep(
    road: Road,
    drive: Drive,
    sensor: LidarModel,
    at: Floats,
    bias: Floats,
    angles: Floats,
    random: np.random.Generator,
    later_s: float = 0.0,
) -> Sweep:
    step = np.radians(sensor.step_deg)
    columns = _HALF_SECTOR - np.arange(int(2 * _HALF_SECTOR / step)) * step - random.uniform() * step
    rings = len(sensor.elevations_deg)
    aside = np.radians(sensor.azimuths_deg) if sensor.azimuths_deg else np.zeros(rings)
    azimuth = columns[:, None] + aside[None, :]
    elevation = np.broadcast_to(np.radians(sensor.elevations_deg), azimuth.shape)
    time_s = np.broadcast_to(-columns[:, None] / (2.0 * np.pi * sensor.rate_hz), azimuth.shape)
    directions = _directions(azimuth, elevation)
    time_s = time_s.ravel()
    wrong_azimuth, wrong_elevation = np.radians(drive.ring_angle_deg) * angles
    distance, albedo, cosine = _returns(
        road, drive, azimuth + wrong_azimuth, elevation + wrong_elevation, at, time_s + later_s
    )
    ring = np.broadcast_to(np.arange(rings), azimuth.shape).ravel()
    there = (distance < sensor.max_range_m) & (random.uniform(size=len(distance)) >= drive.dropout)
    noisy = distance[there] + bias[ring[there]] + random.normal(0.0, drive.noise_m, int(there.sum()))
    shine = albedo[there] * (0.4 + 0.6 * cosine[there]) * random.uniform(0.85, 1.15, int(there.sum()))
    return Sweep(
        stamp_ns=round(1e9 * later_s),
        xyz=(directions[there] * noisy[:, None]).astype(np.float32),
        intensity=np.round(np.clip(_INTENSITY * shine, 0.0, 255.0)).astype(np.float32),
        ring=ring[there].astype(np.uint16),
        offset_ns=(1e9 * time_s[there]).astype(np.int64),
        time_source="per_point",
    )


def _directions(azimuth: Floats, elevation: Floats) -> Floats:
    flat = np.cos(elevation)
    return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], axis=-1).reshape(-1, 3)


def _returns(
    road: Road, drive: Drive, azimuth: Floats, elevation: Floats, at: Floats, time_s: Floats
) -> tuple[Floats, Floats, Floats]:
    """Range, albedo and cosine (N,) of what beams meet at moments (N,) of the moving vehicle."""
    half = np.radians(drive.beam_deg) / 2.0
    heading = np.radians(drive.turn_deg_s) * time_s
    origins = np.repeat(at[None], len(time_s), axis=0)
    origins[:, 0] += drive.speed_m_s * time_s
    origins[:, 1] += drive.speed_m_s * time_s * heading / 2.0
    inside = [(0.0, 0.0), (-half, 0.0), (half, 0.0), (0.0, -half), (0.0, half)] if half else [(0.0, 0.0)]
    met = np.array([
        cast_rays(road, origins, _directions(azimuth + aside + heading.reshape(azimuth.shape), elevation + above))
        for aside, above in inside
    ])  # fmt: skip
    chosen = np.argsort(met[:, 0], axis=0)[len(inside) // 4]
    distance, albedo, cosine = np.take_along_axis(met, chosen[None, None], axis=0)[0]
    return distance, albedo, cosine


def _camera_rays(camera: SimulatedCamera) -> Floats:
    """(H, W, 3) unit directions of the oversampled pixels, LiDAR frame."""
    width, height = camera.image_size
    u = (np.arange(width * _OVERSAMPLE) + 0.5) / _OVERSAMPLE - 0.5
    v = (np.arange(height * _OVERSAMPLE) + 0.5) / _OVERSAMPLE - 0.5
    mesh_u, mesh_v = np.meshgrid(u, v)
    rays = unproject(camera.model, camera.intrinsics, np.column_stack([mesh_u.ravel(), mesh_v.ravel()]))[0]
    return (rays @ camera.T_camera_lidar.R).reshape(len(v), len(u), 3)


def _frame(
    road: Road, drive: Drive, camera: SimulatedCamera, rays: Floats, at: Floats, random: np.random.Generator
) -> NDArray[np.uint8]:
    directions = rays.reshape(-1, 3)
    origins = np.repeat((at + camera.centre())[None], len(directions), axis=0)
    distance, albedo, cosine = cast_rays(road, origins, directions)
    met = np.isfinite(distance)
    where = origins[met] + directions[met] * distance[met, None]
    # Texture that belongs to the surface: it moves with it from frame to frame.
    x, y, z = where.T
    texture = 1.0 + 0.12 * np.sin(7.0 * x + road.seed) * np.sin(5.0 * y) * np.sin(6.0 * z + 1.0)
    bright = np.full(len(distance), road.sky)
    bright[met] = albedo[met] * (0.5 + 0.5 * cosine[met]) * texture
    width, height = camera.image_size
    grey = (drive.light * bright).reshape(rays.shape[:2]).astype(np.float32)
    grey = cv2.resize(grey, (width, height), interpolation=cv2.INTER_AREA)
    soft = np.asarray(cv2.GaussianBlur(grey, (0, 0), _BLUR_PX), np.float64)
    soft = soft + random.normal(0.0, drive.grain, soft.shape)
    return np.repeat(np.clip(soft, 0.0, 255.0).astype(np.uint8)[..., None], 3, axis=2)
