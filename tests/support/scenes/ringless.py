"""Still poses before sensors without rings, drawn wide: rosettes, rows and fans, in rooms with furniture and people.

Frame of a room: x forward, y left, z up, metres; the sensor is the origin and is tilted by some degrees.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from tests.support.scenes.still import Board, Things, meets_board, meets_box, meets_cylinder
from workers.readers.recording import Sweep

Floats = NDArray[np.float64]
Case = Literal["plain", "yaws", "level", "furniture", "people", "boards", "turned", "none", "walk"]
CASES: Final = get_args(Case)
_GROUND_M: Final = -1.1
_PERIOD_NS: Final = 100_000_000
_MIXES_M: Final = 0.5  # half of a pulse: nearer surfaces give one return


@dataclass(frozen=True, slots=True)
class Pattern:
    """How a sensor looks about.

    Attributes:
        kind: a rosette, rows that every sweep repeats, or a fan that no sweep repeats.
        points: rays of a sweep.
        half_deg: half widths of the field, horizontally and vertically.
        noise_m: of a range, deviation; beam_rad: half width of a beam.
        R_room_lidar: (3, 3).
    """

    kind: Literal["rosette", "rows", "fan"]
    points: int
    half_deg: tuple[float, float]
    noise_m: float
    beam_rad: float
    R_room_lidar: Floats

    @classmethod
    def drawn(cls, random: np.random.Generator) -> Pattern:
        """Fields, rates and noises as the data sheets of solid-state sensors state them."""
        kind: Literal["rosette", "rows", "fan"] = ("rosette", "rows", "fan")[int(random.integers(3))]
        half = random.uniform(19.0, 35.0)
        field = {"rosette": (half, half), "rows": (50.0, 13.0), "fan": (60.0, 26.0)}[kind]
        points = int(np.exp(random.uniform(math.log(2_000), math.log(10_000))))
        roll, pitch = np.deg2rad(random.normal(0.0, 2.0, 2))
        about_x = np.array([[1, 0, 0], [0, math.cos(roll), -math.sin(roll)], [0, math.sin(roll), math.cos(roll)]])
        about_y = np.array([[math.cos(pitch), 0, math.sin(pitch)], [0, 1, 0], [-math.sin(pitch), 0, math.cos(pitch)]])
        return cls(kind, points, field, random.uniform(0.004, 0.02), random.uniform(2e-4, 2.5e-3), about_y @ about_x)

    def rays(self, random: np.random.Generator) -> Floats:
        """Unit vectors (N, 3) of one sweep, LiDAR frame."""
        wide, high = np.deg2rad(self.half_deg)
        if self.kind == "rosette":
            angle = np.cumsum(random.uniform(0.0, 0.02, self.points)) + random.uniform(0.0, 6.28)
            radius = wide * np.sin(3.618 * angle)
            azimuth, elevation = radius * np.cos(angle), radius * np.sin(angle)
        elif self.kind == "rows":
            rows = round(math.sqrt(self.points * high / wide))
            number = np.arange(rows * (self.points // rows))
            azimuth = wide * (2.0 * (number // rows + 0.5) / (self.points // rows) - 1.0)
            elevation = high * (2.0 * (number % rows + 0.5) / rows - 1.0)
        else:
            azimuth, elevation = random.uniform(-1.0, 1.0, (2, self.points)) * np.array([[wide], [high]])
        flat = np.cos(elevation)
        return np.column_stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])


@dataclass(frozen=True, slots=True, eq=False)
class Posed:
    """A recording, and what is true of it.

    Attributes:
        pose: (S,) number of each sweep's pose; -1 while the board is carried on.
        corners: (S, 4, 3) top, left, right and bottom corner, metres, LiDAR frame; NaN if there is no such board.
        upper_corner: which corner is looked for, as the detector's option.
    """

    sweeps: Sequence[Sweep]
    pose: NDArray[np.int64]
    corners: Floats
    edges_m: tuple[float, float]
    upper_corner: int


def draw_poses(seed: int, case: Case, poses: int = 6) -> Posed:
    """The recording of that seed.

    Args:
        case: ``plain``; ``yaws``: every second pose is only turned where it stands; ``level``: edges are level;
            ``furniture``: as large as the board, some of it moved meanwhile; ``people``: who stand elsewhere in each
            pose; ``boards``: others of other sizes stand there; ``turned``: the board is not held as is stated;
            ``none``: no board; ``walk``: it never stands still.
    """
    random = np.random.default_rng([seed, 50, CASES.index(case)])
    pattern, room = Pattern.drawn(random), _room(random)
    short = random.uniform(0.45, 0.9)
    edges_m = (short, short * random.uniform(1.1, 1.6))[:: random.choice([-1, 1])]
    upper = int(random.choice([-1, 1])) if case in ("level", "turned") and (case == "level" or seed % 2) else 0
    if case == "furniture":
        for _ in range(4):
            _panel(room, random, edges_m)
    others = [_board(random, 0, random.uniform(0.5, 1.0, 2)) for _ in range(2)] if case == "boards" else []
    each = 1 if case == "walk" else int(random.integers(8, 16))
    shown_corner = (1 if not upper else 0) if case == "turned" else upper
    sweeps: list[Sweep] = []
    pose: list[int] = []
    corners: list[Floats] = []
    board = _board(random, shown_corner, edges_m)
    start, onward = board.apex, random.normal(0.0, 0.05, 2)
    for number in range(poses * 12 if case == "walk" else poses):
        if case == "walk":  # to and fro before the sensor, at walking speed
            aside = np.array([0.3 * math.sin(0.2 * number) + onward[0], 0.9 * math.sin(0.11 * number), 0.0])
            board = replace(board, apex=start + aside)
        elif case == "yaws" and number % 2:
            board = _turned(board, math.radians(random.choice([-1.0, 1.0]) * random.uniform(8.0, 30.0)))
        elif number:
            before = board
            board = _board(random, shown_corner, edges_m)
            if random.uniform() < 0.5:  # carried there, within a second
                for share in np.linspace(0.0, 1.0, 10)[1:-1].tolist():
                    between = replace(before, apex=before.apex + share * (board.apex - before.apex))
                    sweeps.append(
                        _sweep(pattern, _held(room, between, random), [between, *others], random, len(sweeps))
                    )
                    pose.append(-1)
                    corners.append(_corners(between) @ pattern.R_room_lidar)
        things = _held(room, board, random) if case != "none" else Things([*room.boxes], [*room.cylinders])
        if case == "furniture" and number == poses // 2:
            room.boxes[-1] = (*(np.array(room.boxes[-1][:2]) + random.uniform(0.3, 0.8, 2)), *room.boxes[-1][2:])
        if case in ("people", "none"):
            for _ in range(2):
                x, y = random.uniform((2.0, -1.6), (4.8, 1.6))
                things.person(x, y, _GROUND_M, random.uniform(1.5, 1.9), np.array([0.0, 1.0]))
        shown = [*([board] if case != "none" else []), *others]
        true = np.full((4, 3), np.nan) if case in ("none", "turned", "walk") else _corners(board)
        for _ in range(each):
            sweeps.append(_sweep(pattern, things, shown, random, len(sweeps)))
            pose.append(number)
            corners.append(true @ pattern.R_room_lidar)
    return Posed(sweeps, np.array(pose), np.array(corners), edges_m, upper)


def _room(random: np.random.Generator) -> Things:
    things = Things()
    uniform = random.uniform
    far = uniform(5.2, 7.0)
    things.boxes.append((far + 0.5, 0.0, 1.0, 0.5, 8.0, 2.5, uniform(-0.15, 0.15)))
    for side in (-1.0, 1.0):
        things.boxes.append((1.0, side * uniform(2.8, 4.0), 1.0, 8.0, 0.2, 2.5, uniform(-0.05, 0.05)))
    things.boxes.append((3.0, 0.0, _GROUND_M - 0.05, 8.0, 8.0, 0.05, 0.0))
    for _ in range(3):  # cupboards along the walls, and posts
        side = random.choice([-1.0, 1.0])
        tall = uniform(0.3, 0.8)
        things.boxes.append((uniform(2.0, far), side * 2.4, _GROUND_M + tall, uniform(0.2, 0.5), 0.2, tall, 0.0))
        things.cylinders.append((uniform(3.0, far), side * uniform(1.4, 2.2), uniform(0.03, 0.1), _GROUND_M, 1.5))
    return things


def _panel(room: Things, random: np.random.Generator, edges_m: tuple[float, float]) -> None:
    """Something flat and upright, about as large as the board: a screen, the back of a chair, a cardboard box."""
    wide, high = np.array(edges_m) * random.uniform(0.7, 1.2, 2)
    x, y = random.uniform((2.2, -1.8), (4.8, 1.8))
    low = _GROUND_M + random.uniform(0.0, 0.6)
    thick = float(random.choice([0.02, 0.2]))
    room.boxes.append((x, y, low + high / 2, thick, wide / 2, high / 2, random.uniform(-0.7, 0.7)))


def _board(random: np.random.Generator, upper_corner: int, edges_m: Sequence[float]) -> Board:
    """A board somewhere, turned by up to 50 degrees, leaning by up to 25 and rolled by up to 15."""
    one, other = edges_m
    azimuth = random.uniform(-0.28, 0.28)
    yaw = azimuth + float(np.clip(random.normal(0.0, 0.4), -0.87, 0.87))
    lean = float(np.clip(random.normal(0.0, 0.17), -0.44, 0.44))
    towards = np.array([math.cos(yaw), math.sin(yaw), 0.0])
    left = np.array([-towards[1], towards[0], 0.0])
    up = np.array([0.0, 0.0, math.cos(lean)]) + math.sin(lean) * towards
    rest = (
        math.radians(45.0) * (1 + upper_corner)
        if upper_corner
        else random.choice([math.atan2(one, other), math.pi / 4])
    )
    roll = rest + float(np.clip(random.normal(0.0, 0.09), -0.26, 0.26))
    along = np.array([math.cos(roll) * left - math.sin(roll) * up, -math.sin(roll) * left - math.cos(roll) * up])
    middle = random.uniform(2.4, 4.6) * np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
    middle[2] = random.uniform(-0.25, 0.1)
    return Board(middle - 0.5 * (one * along[0] + other * along[1]), along, (one, other))


def _turned(board: Board, yaw: float) -> Board:
    """The board turned about the upright line through its middle."""
    c, s = math.cos(yaw), math.sin(yaw)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    middle = _corners(board).mean(axis=0)
    return Board(middle + turn @ (board.apex - middle), board.along @ turn.T, board.edges_m)


def _corners(board: Board) -> Floats:
    first, second = (edge * along for edge, along in zip(board.edges_m, board.along, strict=True))
    return board.apex + np.array([np.zeros(3), first, second, first + second])


def _held(room: Things, board: Board, random: np.random.Generator) -> Things:
    """The room, and who or what carries the board: a person close behind it, or a post."""
    things = Things([*room.boxes], [*room.cylinders])
    middle = _corners(board).mean(axis=0)
    behind = np.cross(board.along[0], board.along[1])
    behind *= np.sign(behind @ middle)
    x, y, _ = middle + random.uniform(0.25, 0.45) * behind
    if random.uniform() < 0.6:
        things.person(x, y, _GROUND_M, random.uniform(1.5, 1.9), np.array([behind[1], -behind[0]]))
    else:
        things.cylinders.append((x, y, 0.02, _GROUND_M, float(middle[2])))
    return things


def _sweep(
    pattern: Pattern, things: Things, boards: Sequence[Board], random: np.random.Generator, number: int
) -> Sweep:
    own = pattern.rays(random)
    rays = own @ pattern.R_room_lidar.T
    beyond = np.full(len(rays), np.inf)
    for box in things.boxes:
        beyond = np.minimum(beyond, meets_box(rays, box))
    for cylinder in things.cylinders:
        beyond = np.minimum(beyond, meets_cylinder(rays, cylinder))
    reach = beyond
    for board in boards:
        # A beam answers from a board that half of it meets or less; from close behind an edge it answers in between.
        wide = pattern.beam_rad * float(np.linalg.norm(board.apex))
        share = random.uniform(0.0, 1.0, len(rays))
        grown = Board(
            board.apex - wide * board.along.sum(axis=0), board.along, tuple(e + 2.0 * wide for e in board.edges_m)
        )  # type: ignore[arg-type]
        inner, outer = meets_board(rays, board), meets_board(rays, grown)
        behind = np.minimum(beyond, outer + 1.0) - np.minimum(outer, 1e3)
        rim = np.where(behind < _MIXES_M, outer + share * behind, outer)
        met = np.where(np.isfinite(inner), inner, np.where(share < 0.5, rim, np.inf))
        reach = np.minimum(reach, met)
    returned = np.isfinite(reach) & (reach < 60.0) & (random.uniform(size=len(rays)) > 0.01)
    xyz = own[returned] * (reach[returned] + random.normal(0.0, pattern.noise_m, int(returned.sum())))[:, None]
    none = np.zeros(len(xyz))
    return Sweep(
        _PERIOD_NS * number,
        xyz.astype(np.float32),
        none.astype(np.float32),
        none.astype(np.uint16),
        none.astype(np.int64),
    )
