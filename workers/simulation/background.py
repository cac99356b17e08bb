"""The still part of every frame: sky, trees, wall, poles and the marked ground, through the camera's lens."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from workers.simulation.camera import SimulatedCamera
from workers.simulation.scene import Scene

_OVERSAMPLE = 2
_LEVEL = -1e-3  # rays that fall by less meet no ground
_SURELY_GROUND = -0.1  # rays that fall by more meet nothing but ground, poles and wall
_COARSE = 8  # pixels between those that are asked first
_NEAR_RAD = 0.03  # more than lies between those
_GRID_PX = 8  # rays are exact on this grid and interpolated between

Floats = NDArray[np.float32]


def paint_background(camera: SimulatedCamera, scene: Scene, seed: int) -> NDArray[np.uint8]:
    """(height, width, 3) uint8 BGR."""
    direction = _directions(camera)
    origin = camera.centre().astype(np.float32)
    noise = _noise(direction.shape[:2], seed)
    colour = np.zeros_like(direction)
    above = _rows_where(direction[..., 2] > _SURELY_GROUND)
    colour[above] = _sky(direction[above])
    distance = np.full(direction.shape[:2], np.inf, np.float32)
    below = _rows_where(direction[..., 2] < _LEVEL)
    _paint_ground(colour[below], distance[below], direction[below], origin, scene, noise[below])
    _paint_wall(colour, distance, direction, origin, scene, noise)
    _paint_poles(colour, distance, direction, origin, scene)
    width, height = camera.image_size
    small = cv2.resize(colour, (width, height), interpolation=cv2.INTER_AREA)
    return np.clip(small, 0.0, 255.0).astype(np.uint8)


def _directions(camera: SimulatedCamera) -> Floats:
    """(H, W, 3) directions in the LiDAR frame, for the oversampled pixels."""
    width, height = camera.image_size
    u = np.arange(-_GRID_PX, width + 2 * _GRID_PX, _GRID_PX, dtype=np.float64)
    v = np.arange(-_GRID_PX, height + 2 * _GRID_PX, _GRID_PX, dtype=np.float64)
    mesh_u, mesh_v = np.meshgrid(u, v)
    rays = camera.rays(np.column_stack([mesh_u.ravel(), mesh_v.ravel()]))
    grid = rays.reshape(v.size, u.size, 3).astype(np.float32)
    fine_u = (np.arange(width * _OVERSAMPLE) + 0.5) / _OVERSAMPLE - 0.5
    fine_v = (np.arange(height * _OVERSAMPLE) + 0.5) / _OVERSAMPLE - 0.5
    map_u, map_v = np.meshgrid(fine_u / _GRID_PX + 1.0, fine_v / _GRID_PX + 1.0)
    direction = cv2.remap(grid, map_u.astype(np.float32), map_v.astype(np.float32), cv2.INTER_LINEAR)
    return np.asarray(direction, np.float32)


def _rows_where(mask: NDArray[np.bool_]) -> slice:
    """The rows (of H x W) that hold any such pixel, as one band."""
    rows = np.flatnonzero(mask.any(axis=1))
    return slice(int(rows[0]), int(rows[-1]) + 1) if rows.size else slice(0, 0)


def _noise(shape: tuple[int, int], seed: int) -> Floats:
    """Soft grain of about +-1, the same at every run of a seed."""
    random = np.random.default_rng([seed, 4])
    coarse = random.normal(0.0, 0.7, (shape[0] // 10, shape[1] // 10)).astype(np.float32)
    fine = random.normal(0.0, 0.4, (shape[0] // 3, shape[1] // 3)).astype(np.float32)
    size = (shape[1], shape[0])
    grain: Floats = np.asarray(cv2.resize(coarse, size), np.float32)
    np.add(grain, cv2.resize(fine, size), out=grain)
    return grain


def _colour(blue: float, green: float, red: float) -> Floats:
    return np.array([blue, green, red], np.float32)


def _sky(direction: Floats) -> Floats:
    """Bright at the horizon, blue above, with a line of trees far behind the wall."""
    flat = np.hypot(direction[..., 0], direction[..., 1])
    elevation = np.arctan2(direction[..., 2], flat)
    azimuth = np.arctan2(direction[..., 1], direction[..., 0])
    blend = np.clip(elevation / 0.5, 0.0, 1.0)[..., None]
    colour = (1.0 - blend) * _colour(232, 222, 210) + blend * _colour(214, 168, 112)
    hills = 0.085 + 0.016 * np.sin(7.0 * azimuth + 1.0) + 0.009 * np.sin(23.0 * azimuth)
    crowns = 0.006 * np.abs(np.sin(61.0 * azimuth)) + 0.004 * np.abs(np.sin(143.0 * azimuth + 0.7))
    trees = elevation < hills + crowns
    shade = (0.8 + 2.0 * np.clip(elevation, 0.0, 0.1))[..., None]
    colour = np.where(trees[..., None], _colour(74, 104, 82) * shade, colour)
    return np.asarray(colour, np.float32)


def _line(distance: Floats, half_width: float, footprint: Floats) -> Floats:
    """Return how much of a pixel a painted line covers: softened by the pixel's own size on the surface."""
    return np.clip((half_width - np.abs(distance)) / footprint + 0.5, 0.0, 1.0).astype(np.float32)


def _paint_ground(
    colour: Floats, distance: Floats, direction: Floats, origin: Floats, scene: Scene, noise: Floats
) -> None:
    """Asphalt with a white grid of 2.5 m, as on a parking lot; it fades into the haze."""
    down = direction[..., 2] < _LEVEL
    reach = np.where(down, (scene.ground_z - origin[2]) / np.where(down, direction[..., 2], -1.0), np.inf)
    hit = down & (reach < 300.0)
    along = np.where(hit, reach, 0.0).astype(np.float32)
    x = origin[0] + along * direction[..., 0]
    y = origin[1] + along * direction[..., 1]
    footprint = np.maximum(along / 700.0, 1e-3) * np.maximum(along / 2.0, 1.0)
    across_x = np.abs(np.mod(x + 1.25, 2.5) - 1.25)
    across_y = np.abs(np.mod(y + 1.25, 2.5) - 1.25)
    paint = np.maximum(_line(across_x, 0.05, footprint), _line(across_y, 0.05, np.maximum(along / 700.0, 1e-3)))
    paint = paint * ((x > 2.0) & (x < 31.0) & (np.abs(y) < 7.55)) * 0.75
    asphalt = _colour(112, 112, 110) + 5.0 * noise[..., None]
    ground = asphalt + paint[..., None] * (_colour(214, 218, 220) - asphalt)
    haze = np.clip(along / 260.0, 0.0, 0.6)[..., None]
    ground = (1.0 - haze) * ground + haze * _colour(205, 200, 192)
    colour[hit] = ground[hit]
    distance[hit] = along[hit]


def _paint_wall(
    colour: Floats, distance: Floats, direction: Floats, origin: Floats, scene: Scene, noise: Floats
) -> None:
    """A low building across the end of the field, with a row of windows."""
    ahead = direction[..., 0] > 1e-3
    reach = np.where(ahead, (scene.wall_x - origin[0]) / np.where(ahead, direction[..., 0], 1.0), np.inf)
    along = np.where(ahead, reach, 0.0).astype(np.float32)
    y = origin[1] + along * direction[..., 1]
    height = origin[2] + along * direction[..., 2] - scene.ground_z
    hit = ahead & (np.abs(y) < scene.wall_half_width) & (height < scene.wall_height) & (height > 0.0)
    hit &= reach < distance
    window = (np.abs(np.mod(y, 4.0) - 2.0) < 0.9) & (np.abs(height - 1.7) < 0.55)
    wall = np.where(window[..., None], _colour(120, 100, 84), _colour(158, 176, 190) + 3.0 * noise[..., None])
    roof = height > scene.wall_height - 0.25
    wall = np.where(roof[..., None], _colour(92, 92, 100), wall)
    colour[hit] = wall[hit]
    distance[hit] = along[hit]


def _paint_poles(colour: Floats, distance: Floats, direction: Floats, origin: Floats, scene: Scene) -> None:
    """Lamp posts, each painted where a coarse look finds it."""
    coarse = direction[::_COARSE, ::_COARSE]
    flat = np.hypot(coarse[..., 0], coarse[..., 1])
    for pole in scene.poles.astype(np.float32):
        dx, dy = pole[0] - origin[0], pole[1] - origin[1]
        across = np.abs(coarse[..., 0] * dy - coarse[..., 1] * dx) / flat
        along = coarse[..., 0] * dx + coarse[..., 1] * dy
        is_hit = (across < pole[2] + _NEAR_RAD * np.hypot(dx, dy)) & (along > 0.0)
        if is_hit.any():
            columns = np.flatnonzero(is_hit.any(axis=0))
            box = slice(max(int(columns[0]) - 1, 0) * _COARSE, (int(columns[-1]) + 2) * _COARSE)
            _paint_pole(colour[:, box], distance[:, box], direction[:, box], origin, scene.ground_z, pole)


def _paint_pole(
    colour: Floats, distance: Floats, direction: Floats, origin: Floats, ground_z: float, pole: Floats
) -> None:
    """Rounder where the light comes from the left."""
    x, y, radius, high = pole
    a = direction[..., 0] ** 2 + direction[..., 1] ** 2
    dx, dy = x - origin[0], y - origin[1]
    along = direction[..., 0] * dx + direction[..., 1] * dy
    across = (direction[..., 0] * dy - direction[..., 1] * dx) / np.sqrt(a)
    rest = radius**2 - across**2
    reach = (along - np.sqrt(np.maximum(rest, 0.0) * a)) / a
    height = origin[2] + reach * direction[..., 2] - ground_z
    hit = (rest > 0.0) & (along > 0.0) & (height > 0.0) & (height < high) & (reach < distance)
    light = (0.75 - 0.35 * across / radius)[..., None]
    colour[hit] = (light * _colour(150, 150, 146))[hit]
    distance[hit] = reach[hit]
