"""Simulated still poses: a street, a garage or a room, a board on its tip, and who else stands there.

Everything is drawn anew for each seed: walls, cars, passers-by, the sensor's noise and the biases of its rings.
Frame: x forward, y left, z up, metres; the sensor is the origin.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from workers.readers.recording import Sweep
from workers.simulation.sensors import SENSORS
from workers.vertices.sweep_source import Listed

Floats = NDArray[np.float64]
Place = Literal["street", "garage", "room"]
BOARD: Final = 1
_START_NS: Final = 1_780_000_000_000_000_000
_FARTHEST_M: Final = 100.0
_LEAST_STEP_DEG: Final = 0.2  # finer ones take long to compute


@dataclass(frozen=True, slots=True)
class Setting:
    """Where a recording is made.

    Attributes:
        sensor: name in `workers.simulation.sensors.SENSORS`.
        ground_z: height of the ground.
        near_m, far_m: distances of the board.
        aside_rad: the board stands within this azimuth to either side.
        edges_m: lengths of the board's edges.
        carried: by a person, or else on a tripod.
        passers: most people who stand elsewhere in each pose.
    """

    sensor: str
    ground_z: float
    near_m: float
    far_m: float
    aside_rad: float
    edges_m: tuple[float, float]
    carried: bool
    passers: int


SETTINGS: Final[dict[Place, Setting]] = {
    "street": Setting("vlp16", -1.9, 6.0, 14.0, 0.5, (0.89, 1.2), True, 3),
    "garage": Setting("os1-64", -1.2, 2.5, 3.8, 0.25, (1.0, 1.0), True, 1),
    "room": Setting("vlp16", -0.9, 1.7, 3.4, 0.55, (0.6, 0.85), False, 1),
}


@dataclass(slots=True)
class Things:
    """Upright boxes (x, y, z of the middle, half length, half width, half height, yaw) and cylinders (x, y, radius,
    lowest and highest z)."""

    boxes: list[tuple[float, ...]] = field(default_factory=list[tuple[float, ...]])
    cylinders: list[tuple[float, ...]] = field(default_factory=list[tuple[float, ...]])

    def person(self, x: float, y: float, ground_z: float, tall: float, aside: Floats) -> None:
        """Two legs, a trunk and a head; ``aside`` (2,) is the way from one leg to the other."""
        for side in (-0.1, 0.1):
            at = np.array([x, y]) + side * aside
            self.cylinders.append((at[0], at[1], 0.08, ground_z, ground_z + 0.48 * tall))
        self.cylinders.append((x, y, 0.17, ground_z + 0.48 * tall, ground_z + 0.85 * tall))
        self.cylinders.append((x, y, 0.1, ground_z + 0.85 * tall, ground_z + tall))


@dataclass(frozen=True, slots=True, eq=False)
class Board:
    """Apex (3,), unit vectors (2, 3) along the edges to the lower left and right, and their lengths."""

    apex: Floats
    along: Floats
    edges_m: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Recorded:
    """Sweeps, the apex in each (S, 3), the number of its pose (S,), and how many rings met the board (S,)."""

    sweeps: Sequence[Sweep]
    apex: Floats
    pose: NDArray[np.int64]
    rings: NDArray[np.int64]
    edges_m: tuple[float, float]

    @property
    def source(self) -> Listed:
        """The sweeps as a detector takes them."""
        return Listed(self.sweeps)


def still_poses(place: Place, seed: int, poses: int, *, each: int = 1, apart_s: float = 0.1) -> Recorded:
    """A recording of so many poses with ``each`` sweeps of every pose.

    Args:
        apart_s: seconds between two sweeps' stamps, true or made up.
    """
    setting = SETTINGS[place]
    random = np.random.default_rng([seed, len(place)])
    around = _surroundings(place, setting, random)
    sensor = Sensor.drawn(setting.sensor, random)
    sweeps: list[Sweep] = []
    apexes: list[Floats] = []
    rings: list[int] = []
    for _ in range(poses):
        board, things = _pose(setting, around, random)
        for _ in range(each):
            sweep, label = sensor.sweep(things, board, setting.ground_z, random, len(sweeps), apart_s)
            sweeps.append(sweep)
            apexes.append(board.apex)
            rings.append(int(np.unique(sweep.ring[label == BOARD]).size))
    number = np.repeat(np.arange(poses), each)
    return Recorded(sweeps, np.array(apexes), number, np.array(rings), setting.edges_m)


def drive(seed: int, sweeps: int, speed_m_s: float = 10.0) -> Listed:
    """Sweeps of a car that drives along the street, ten a second; nobody holds a board."""
    setting = SETTINGS["street"]
    random = np.random.default_rng([seed, 99])
    around = _surroundings("street", setting, random, length_m=60.0 + 0.1 * sweeps * speed_m_s)
    sensor = Sensor.drawn(setting.sensor, random)
    found: list[Sweep] = []
    for number in range(sweeps):
        x = 0.1 * number * speed_m_s
        things = Things(
            [(box[0] - x, *box[1:]) for box in around.boxes], [(pole[0] - x, *pole[1:]) for pole in around.cylinders]
        )
        found.append(sensor.sweep(things, None, setting.ground_z, random, number, 0.1)[0])
    return Listed(found)


def _surroundings(place: Place, setting: Setting, random: np.random.Generator, length_m: float = 60.0) -> Things:
    things = Things()
    ground = setting.ground_z
    uniform = random.uniform
    if place == "street":
        for side in (-1.0, 1.0):
            x, front = -30.0, uniform(7.0, 11.0)
            while x < length_m:
                long, tall = uniform(6.0, 15.0), uniform(4.0, 9.0)
                things.boxes.append(
                    (x + long / 2, side * (front + 2.0), ground + tall / 2, long / 2, 2.0, tall / 2, 0.0)
                )
                x += long + uniform(0.0, 4.0)
                front += uniform(-0.5, 0.5)
            for x in np.arange(-20.0, length_m, uniform(6.5, 9.0)):
                if random.uniform() < 0.6:
                    at = side * uniform(4.6, 5.4)
                    things.boxes.append((x, at, ground + 0.75, 2.1, 0.9, 0.75, uniform(-0.05, 0.05)))
                    things.boxes.append((x, at, ground + 1.2, 1.1, 0.8, 0.3, 0.0))
                things.cylinders.append((x + 3.0, side * 6.3, uniform(0.06, 0.2), ground, ground + 5.0))
        things.boxes.append((length_m + 20.0, 0.0, ground + 4.0, 2.0, 15.0, 4.0, 0.0))
    else:
        far = uniform(4.5, 7.0) if place == "garage" else uniform(3.9, 5.0)
        sides = (uniform(2.3, 4.0), -uniform(2.3, 4.0))
        things.boxes.append((far + 0.5, 0.0, ground + 2.0, 0.5, 8.0, 2.0, uniform(-0.1, 0.1)))
        things.boxes.append((-5.0, 0.0, ground + 2.0, 0.5, 8.0, 2.0, 0.0))
        for y in sides:
            things.boxes.append((1.0, y + math.copysign(0.5, y), ground + 2.0, 8.0, 0.5, 2.0, uniform(-0.05, 0.05)))
            things.boxes.append((uniform(1.0, 3.5), y * 0.92, ground + 0.5, 0.5, 0.2, uniform(0.3, 0.7), 0.0))
        things.boxes.append((1.0, 0.0, ground + 3.2, 8.0, 8.0, 0.1, 0.0))
        for _ in range(3):
            side = math.copysign(uniform(1.7, 2.2), random.uniform() - 0.5)
            things.cylinders.append((uniform(0.5, far), side, uniform(0.03, 0.2), ground, ground + 3.0))
    return things


def _pose(setting: Setting, around: Things, random: np.random.Generator) -> tuple[Board, Things]:
    """A board somewhere, with who holds it, before the surroundings; passers-by stand elsewhere in each pose."""
    things = Things(list(around.boxes), list(around.cylinders))
    one, other = setting.edges_m
    azimuth = random.uniform(-setting.aside_rad, setting.aside_rad)
    distance = random.uniform(setting.near_m, setting.far_m)
    away = np.array([math.cos(azimuth), math.sin(azimuth)])
    diagonal = math.hypot(one, other)
    height = diagonal + random.uniform(0.15, 0.5) + (0.0 if setting.carried else 0.2)
    apex = np.array([*(distance * away), setting.ground_z + height])
    yaw = azimuth + random.normal(0.0, 0.15)
    towards = np.array([math.cos(yaw), math.sin(yaw), 0.0])
    left = np.array([-towards[1], towards[0], 0.0])
    lean = random.normal(0.1, 0.08)
    up = np.array([0.0, 0.0, math.cos(lean)]) + math.sin(lean) * towards
    # The diagonal upright, or both edges falling alike, and some degrees of roll.
    roll = random.choice([math.atan2(one, other), math.radians(45.0)]) + np.clip(random.normal(0.0, 0.09), -0.2, 0.2)
    along = np.array([math.cos(roll) * left - math.sin(roll) * up, -math.sin(roll) * left - math.cos(roll) * up])
    behind = random.uniform(0.22, 0.6)
    x, y = apex[:2] + behind * towards[:2]
    if setting.carried:
        tall = min(random.uniform(1.6, 1.9), height + 0.1) if random.uniform() < 0.5 else height - 0.1
        things.person(x, y, setting.ground_z, max(tall, 1.2), left[:2])
    else:
        middle = apex + 0.5 * (one * along[0] + other * along[1]) + 0.06 * towards
        things.cylinders.append((middle[0], middle[1], 0.03, setting.ground_z, float(middle[2])))
    for _ in range(random.integers(0, setting.passers + 1)):
        place = random.uniform((setting.near_m, -0.7), (1.6 * setting.far_m, 0.7))
        at = place[0] * np.array([math.cos(place[1]), math.sin(place[1])])
        if np.hypot(*(at - apex[:2])) > 1.3 and abs(place[1] - azimuth) > 0.6 / distance:
            aside = np.array([-at[1], at[0]]) / place[0]
            things.person(at[0], at[1], setting.ground_z, random.uniform(1.5, 1.9), aside)
    return Board(apex, along, setting.edges_m), things


@dataclass(frozen=True, slots=True, eq=False)
class Sensor:
    """Elevations (R,) and biases (R,) of the rings, step of the azimuth, noise and share of lost returns."""

    elevation: Floats
    bias_m: Floats
    step: float
    noise_m: float
    lost: float

    @classmethod
    def drawn(cls, name: str, random: np.random.Generator) -> Sensor:
        model = SENSORS[name]
        elevation = np.deg2rad(np.array(model.elevations_deg))
        return cls(
            elevation,
            random.normal(0.0, random.uniform(0.0, 0.012), elevation.size),
            math.radians(max(model.step_deg, _LEAST_STEP_DEG)),
            random.uniform(0.005, 0.015),
            random.uniform(0.0, 0.02),
        )

    def sweep(
        self,
        things: Things,
        board: Board | None,
        ground_z: float,
        random: np.random.Generator,
        number: int,
        apart_s: float,
    ) -> tuple[Sweep, NDArray[np.int64]]:
        columns = int(2.0 * math.pi / self.step)
        azimuth = -math.pi + (np.arange(columns) + random.uniform()) * self.step
        e, a = np.meshgrid(self.elevation, azimuth, indexing="ij")
        grid = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=-1)
        nearest = np.where(grid[..., 2] < 0.0, ground_z / np.minimum(grid[..., 2], -1e-9), np.inf)
        for box in things.boxes:
            looks = looking_at(azimuth, _footprint(box))
            nearest[:, looks] = np.minimum(nearest[:, looks], meets_box(grid[:, looks], box))
        for cylinder in things.cylinders:
            x, y, radius = cylinder[:3]
            around = radius * np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]])
            looks = looking_at(azimuth, np.array([x, y]) + around)
            nearest[:, looks] = np.minimum(nearest[:, looks], meets_cylinder(grid[:, looks], cylinder))
        rays, distance = grid.reshape(-1, 3), nearest.ravel()
        label = np.zeros(distance.size, np.int64)
        if board is not None:
            met = meets_board(rays, board)
            label[met < distance] = BOARD
            distance = np.minimum(distance, met)
        ring = np.repeat(np.arange(self.elevation.size), columns)
        returned = (distance < _FARTHEST_M) & (random.uniform(size=distance.size) >= self.lost)
        noisy = distance + self.bias_m[ring] + random.normal(0.0, self.noise_m, distance.size)
        kept = np.flatnonzero(returned & (noisy > 0.3))
        xyz = (rays[kept] * noisy[kept, None]).astype(np.float32)
        stamp_ns = _START_NS + number * round(apart_s * 1e9)
        zeros = np.zeros(kept.size)
        sweep = Sweep(stamp_ns, xyz, zeros.astype(np.float32), ring[kept].astype(np.uint16), zeros.astype(np.int64))
        return sweep, label[kept]


def looking_at(azimuth: Floats, corners: Floats) -> NDArray[np.intp]:
    """Which of the azimuths (C,) lie between those of a footprint's corners (4, 2).

    All of them where the sensor stands above the footprint, or nearly so.
    """
    towards = np.arctan2(corners[:, 1], corners[:, 0])
    middle = math.atan2(np.sin(towards).sum(), np.cos(towards).sum())
    half = np.abs(_wrapped(towards - middle)).max() + 1e-6
    if half > 0.45 * math.pi:
        return np.arange(len(azimuth))
    return np.flatnonzero(np.abs(_wrapped(azimuth - middle)) < half)


def _wrapped(angle: Floats) -> Floats:
    return np.remainder(angle + math.pi, 2.0 * math.pi) - math.pi


def _footprint(box: tuple[float, ...]) -> Floats:
    """(4, 2) the corners of an upright box seen from above."""
    x, y, _, long, wide, _, yaw = box
    along, across = np.array([math.cos(yaw), math.sin(yaw)]), np.array([-math.sin(yaw), math.cos(yaw)])
    return np.array([[x, y] + a * long * along + b * wide * across for a in (-1.0, 1.0) for b in (-1.0, 1.0)])


def meets_box(rays: Floats, box: tuple[float, ...]) -> Floats:
    x, y, z, *half, yaw = box
    c, s = math.cos(yaw), math.sin(yaw)
    turned = (c * rays[..., 0] + s * rays[..., 1], c * rays[..., 1] - s * rays[..., 0], rays[..., 2])
    middle = (c * x + s * y, c * y - s * x, z)
    first, last = np.zeros(rays.shape[:-1]), np.full(rays.shape[:-1], np.inf)
    for ray, centre, reach in zip(turned, middle, half, strict=True):
        inverse = 1.0 / np.where(np.abs(ray) < 1e-9, 1e-9, ray)
        one, other = (centre - reach) * inverse, (centre + reach) * inverse
        first, last = np.maximum(first, np.minimum(one, other)), np.minimum(last, np.maximum(one, other))
    return np.where((first < last) & (first > 0.0), first, np.inf)


def meets_cylinder(rays: Floats, cylinder: tuple[float, ...]) -> Floats:
    x, y, radius, low, high = cylinder
    flat = rays[..., 0] ** 2 + rays[..., 1] ** 2
    along = (rays[..., 0] * x + rays[..., 1] * y) / flat
    inner = along**2 - (x * x + y * y - radius**2) / flat
    distance = along - np.sqrt(np.maximum(inner, 0.0))
    height = distance * rays[..., 2]
    return np.where((inner > 0.0) & (distance > 0.0) & (height > low) & (height < high), distance, np.inf)


def meets_board(rays: Floats, board: Board) -> Floats:
    normal = np.cross(board.along[0], board.along[1])
    towards = rays @ normal
    distance = (board.apex @ normal) / np.where(np.abs(towards) < 1e-9, 1e-9, towards)
    p, q = board.along @ (rays * distance[:, None] - board.apex).T
    on_board = (distance > 0.0) & (p > 0.0) & (p < board.edges_m[0]) & (q > 0.0) & (q < board.edges_m[1])
    return np.where(on_board, distance, np.inf)
