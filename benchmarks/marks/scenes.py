"""Walks and still poses with a board in front of one camera, drawn wide and rendered with sub-pixel truth.

Whatever stands in a frame is painted on a canvas of 8 times the resolution without anti-aliasing and averaged over
areas: cv2's LINE_AA would grow every edge by 0.6 px. Frame of a scene: x forward, y left, z up, metres, the LiDAR at
the origin; the LiDAR's own frame is turned about z by any angle, so that there is no nominal mount.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from apexcal.documents.corners import CornerName
from apexcal.documents.simulation import Disturbances
from apexcal.geometry.rotations import FORWARD_LIDAR_TO_OPTICAL, rotation_from_vector
from apexcal.geometry.se3 import SE3
from tests.support.scenes.held_board import BoardHold, HeldWalk
from workers.geometry.models import INTRINSICS, ModelName
from workers.geometry.spherical import to_xyz
from workers.marks.sights import Image, Lens, MountedLens, Sight
from workers.simulation.walker import Poses, Walk

Floats = NDArray[np.float64]
Pattern = Literal["plain", "border", "chess", "tag"]
OVERSAMPLE: Final = 8
EDGE_SIGMA_M: Final = 0.0008  # the tolerance of ISO 2768-1 m for lengths of 0.4 to 1 m, taken as a standard deviation
_EDGE_STEPS: Final = 8
_MASK_PX: Final = 1.5  # of the unsharp mask: its lobes are 3 px away, as in the crops
_HALF_S: Final = 0.5  # `REACH_NS` of the pairs' velocities
_UP: Final = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True)
class Draw:
    """What a seed draws.

    Attributes:
        contrast: grey levels between the board and what is behind it on average; its sign is drawn too.
        blur_px: standard deviation. motion_ms: exposure.
        gain_step: factor by which the exposure changes for some of the frames.
        sharpening: amount of an unsharp mask. rim_m: a lit or dark rim outside of one upper edge, in half of the
            frames. blunt_m: what is cut off the tip along both edges. `draw` leaves these three at 0 (see `CELLS`).
        clock_ms: how far the camera's clock is ahead of the one by which frames were paired.
    """

    seed: int
    size: tuple[int, int]
    model: ModelName
    lens_stated: bool
    still: bool
    count: int
    board_m: tuple[float, float]
    size_stated: bool
    pattern: Pattern
    contrast: float
    texture: float
    blur_px: float
    noise: float
    motion_ms: float
    head_above_m: float
    second: Literal["none", "beside", "behind"]
    gain_step: float
    tip_outside: bool
    thermal: bool
    sharpening: float = 0.0
    rim_m: float = 0.0
    blunt_m: float = 0.0
    clock_ms: float = 0.0


CELLS: Final[dict[str, dict[str, float]]] = {
    "neither": {},
    "sharpened": {"sharpening": 1.0},
    "rims": {"rim_m": 0.01},
    "blunt": {"blunt_m": 0.01},
    "all three": {"sharpening": 1.0, "rim_m": 0.01, "blunt_m": 0.01},
}
"""As crops of `vlp16-diamond-board` show them, poses from 0. Sharpening: undershoots of 15 to 25 % on both sides of
edges in poses 2, 3, 11, 14. Rims: a strip of 3 to 6 px, a centimetre, along the upper left edge in poses 4, 5, 10,
12, 16, 18, the published corner at its inner side. Blunt: the tips of poses 10 and 16 end some pixels early."""


def cell_draw(seed: int, cell: str) -> Draw:
    """Still poses of a plain board in visible light, with lens and size stated, of this cell."""
    return replace(
        draw(seed), still=True, count=14, pattern="plain", head_above_m=0.0, second="none", thermal=False,
        size=(1920, 1200), lens_stated=True, size_stated=True, tip_outside=False, motion_ms=0.0, gain_step=1.0,
        **CELLS[cell],  # pyright: ignore[reportArgumentType]
    )  # fmt: skip


def draw(seed: int) -> Draw:
    """The scene of a seed."""
    random = np.random.default_rng([seed, 37])
    uniform = random.uniform
    thermal = bool(uniform() < 0.12)
    fisheye = bool(uniform() < 0.2)
    still = bool(uniform() < 0.4)
    short = uniform(0.45, 0.9)
    board = (short, min(short * (1.0 if uniform() < 0.3 else uniform(1.1, 1.6)), 1.3))
    outside = bool(uniform() < 0.12)
    sizes = ((1920, 1080), (1920, 1200), (1280, 720), (960, 600))
    return Draw(
        seed=seed,
        size=(640, 512) if thermal else sizes[int(random.choice(4, p=[0.4, 0.2, 0.2, 0.2]))],
        model="kannala_brandt" if fisheye else ("brown_conrady" if uniform() < 0.7 else "pinhole"),
        lens_stated=bool(uniform() < 0.8) or fisheye,
        still=still,
        count=int(uniform(10, 26)) if still else int(uniform(30, 61)),
        board_m=board if uniform() < 0.5 else board[::-1],
        size_stated=bool(uniform() < 0.65) or outside,
        pattern=str(random.choice(["plain", "border", "chess", "tag"], p=[0.5, 0.2, 0.2, 0.1])),  # type: ignore[arg-type]
        contrast=float(uniform(15.0, 120.0)),
        texture=float(uniform(2.0, 20.0)),
        blur_px=float(uniform(0.0, 2.5)),
        noise=float(uniform(0.7, 3.5)),
        motion_ms=0.0 if still else float(uniform(0.0, 12.0)),
        head_above_m=float(uniform(0.03, 0.2)) if uniform() < 0.25 else 0.0,
        second=str(random.choice(["none", "beside", "behind"], p=[0.75, 0.15, 0.1])),  # type: ignore[arg-type]
        gain_step=float(uniform(1.1, 1.6)) if uniform() < 0.25 else 1.0,
        tip_outside=outside,
        thermal=thermal,
    )


class Scene:
    """A drawn scene: its camera, its sights as a LiDAR would give them, and its frames."""

    def __init__(self, drawn: Draw) -> None:
        self.drawn = drawn
        random = np.random.default_rng([drawn.seed, 38])
        self._turn = rotation_from_vector(np.array([0.0, 0.0, random.uniform(-math.pi, math.pi)]))
        self.camera = _camera(drawn, random, self._turn)
        self._ground_z = -random.uniform(1.2, 2.0)
        walk = HeldWalk(
            drawn.seed,
            240.0,
            self._ground_z,
            plan="yard",
            disturbances=Disturbances(head_above_m=drawn.head_above_m, second_person=drawn.second),
            hold=BoardHold(
                rolled_deg=float(random.uniform(-12.0, 12.0)),
                tilted_deg=float(np.clip(random.normal(0.0, 6.0), -15.0, 15.0)),
            ),
            board_m=drawn.board_m,
        )
        times = self._times(walk, random)
        self._poses = walk.poses(times)
        later = walk.poses(times + drawn.motion_ms * 1e-3)
        self.truth = {name: self._pixels(xyz) for name, xyz in _corners(self._poses).items()}
        self._moved = self._pixels(later.apex) - self.truth["top"]
        # What the LiDAR saw at the moments that the pairing took for the frames'.
        self._paired = walk.poses(times + drawn.clock_ms * 1e-3)
        self._velocity = _velocity(walk, times + drawn.clock_ms * 1e-3, drawn)
        self.sights = self._sights(random)
        self._background = _background(drawn, random)
        self._levels = _cut(drawn, random, _levels(drawn, random, self._background))
        self._shirt = random.uniform(20.0, 230.0, 4)
        self._gains = np.where(
            np.arange(len(times)) % max(len(times) // 3, 1) < len(times) // 6, drawn.gain_step, 1.0
        )

    def __len__(self) -> int:
        return len(self.sights)

    @property
    def lens(self) -> Lens | None:
        """As it is stated to the machine."""
        return self.camera.lens if self.drawn.lens_stated else None

    def visible(self, index: int, name: CornerName = "top") -> bool:
        """Whether a corner lies in its image, at a short side of at least 20 px, and nobody stands before it."""
        pixel, width, height = self.truth[name][index], *self.drawn.size
        inside = bool(np.all(np.isfinite(pixel))) and 8.0 < pixel[0] < width - 9.0 and 8.0 < pixel[1] < height - 9.0
        return inside and self.short_side(index) >= 20.0 and not self._hidden(index, pixel)

    def short_side(self, index: int) -> float:
        """Length of the shorter upper edge in the image, px."""
        tip = self.truth["top"][index]
        return float(min(np.hypot(*(self.truth[name][index] - tip)) for name in ("left", "right")))

    def __getitem__(self, index: int, /) -> Image:
        """The frame (H, W), uint8, or uint16 of a thermal camera."""
        drawn = self.drawn
        random = np.random.default_rng([drawn.seed, 39, index])
        image = self._painted(index).astype(np.float32)
        if drawn.motion_ms > 0.0:
            image = _smeared(image, self._moved[index])
        if drawn.blur_px > 0.2:
            image = np.asarray(cv2.GaussianBlur(image, (0, 0), drawn.blur_px), np.float32)
        if drawn.sharpening > 0.0:
            soft = np.asarray(cv2.GaussianBlur(image, (0, 0), _MASK_PX), np.float32)
            image = image + np.float32(drawn.sharpening) * (image - soft)
        image = image * np.float32(self._gains[index]) + random.normal(0.0, drawn.noise, image.shape).astype(
            np.float32
        )
        if drawn.thermal:
            return np.clip(np.rint(7000.0 + 4.0 * image), 0, 65535).astype(np.uint16)
        return np.clip(np.rint(image), 0, 255).astype(np.uint8)

    def _pixels(self, xyz: Floats) -> Floats:
        return self.camera.pixels(xyz @ self._turn.T)

    def _times(self, walk: Walk, random: np.random.Generator) -> Floats:
        """Moments at which the tip is in the image, or above it, evenly over the walk."""
        every = np.arange(0.0, 239.0, 0.2)
        poses = walk.poses(every)
        corners = {name: self._pixels(xyz) for name, xyz in _corners(poses).items()}
        tip, (width, height) = corners["top"], self.drawn.size
        with np.errstate(invalid="ignore"):
            beside = (tip[:, 0] > 10.0) & (tip[:, 0] < width - 11.0) & (tip[:, 1] < height - 11.0)
            inside = beside & (tip[:, 1] > 10.0)
            near = np.hypot(*(corners["left"] - tip).T) > 15.0
            lower = (corners["left"][:, 1] > 20.0) & (corners["bottom"][:, 1] < height - 11.0)
        wanted = np.flatnonzero((beside & lower if self.drawn.tip_outside else inside) & near)
        if len(wanted) == 0:
            return np.empty(0)
        count = min(self.drawn.count, len(wanted))
        if self.drawn.still:
            return every[np.sort(random.choice(wanted, count, replace=False))]
        return every[wanted[np.linspace(0, len(wanted) - 1, count).astype(int)]]

    def _sights(self, random: np.random.Generator) -> list[Sight]:
        """As a detector states them: errors as large as their covariances say, three in a hundred far off."""
        sigma = np.array([*np.radians(random.uniform(0.02, 0.06, 2)), random.uniform(0.004, 0.015)])
        roll_sigma, side_sigma = math.radians(random.uniform(0.5, 2.5)), random.uniform(0.005, 0.02)
        sights: list[Sight] = []
        for index in range(len(self._paired.apex)):
            corners = {name: self._turn @ xyz[index] for name, xyz in _corners(self._paired).items()}
            spread = to_xyz(np.diag(sigma**2)[None], corners["top"][None])[0]
            off = random.multivariate_normal(np.zeros(3), spread)
            if random.uniform() < 0.03:
                off = off + random.normal(0.0, 0.3, 3)
            noisy: dict[CornerName, Floats] = {"top": corners["top"] + off}
            if self.drawn.size_stated:
                for name in ("left", "right", "bottom"):
                    noisy[name] = corners[name] + off + random.normal(0.0, side_sigma, 3)
            falls = math.asin(-float(self._paired.edge_left[index][2]))
            roll = falls - 0.25 * math.pi + random.normal(0.0, roll_sigma)
            sights.append(Sight(index, noisy, spread, roll, self._turn @ self._velocity[index]))
        return sights

    def _hidden(self, index: int, pixel: Floats) -> bool:
        second = self._poses.second
        if second is None or np.linalg.norm(second.body[index]) > np.linalg.norm(self._poses.apex[index, :2]):
            return False
        shapes = _person(second.body[index], second.left[index], float(second.height[index]), self._ground_z)
        return any(
            cv2.pointPolygonTest(
                self._pixels(shape).astype(np.float32)[:, None], (float(pixel[0]), float(pixel[1])), True
            )
            > -12.0
            for shape in shapes
            if np.all(np.isfinite(self._pixels(shape)))
        )

    def _painted(self, index: int) -> NDArray[np.uint8]:
        image = self._background.copy()
        seen = [(self._pixels(outline), level) for outline, level in self._shapes(index)]
        seen = [(pixels, level) for pixels, level in seen if np.all(np.abs(pixels) < 20_000.0)]
        if not seen:
            return image
        corners = np.concatenate([pixels for pixels, _ in seen])
        low = np.clip(np.floor(corners.min(axis=0)).astype(int) - 2, 0, self.drawn.size)
        high = np.clip(np.ceil(corners.max(axis=0)).astype(int) + 3, 0, self.drawn.size)
        if np.any(high - low < 2):
            return image
        part = image[low[1] : high[1], low[0] : high[0]]
        canvas = part.repeat(OVERSAMPLE, axis=0).repeat(OVERSAMPLE, axis=1)
        for pixels, level in seen:
            fine = (pixels - low + 0.5) * OVERSAMPLE - 0.5
            cv2.fillPoly(canvas, [np.round(fine * 16).astype(np.int32)], level, lineType=cv2.LINE_8, shift=4)
        while canvas.shape[0] > part.shape[0]:
            half = (canvas.shape[1] // 2, canvas.shape[0] // 2)
            canvas = np.asarray(cv2.resize(canvas, half, interpolation=cv2.INTER_AREA), np.uint8)
        part[:] = canvas
        return image

    def _shapes(self, index: int) -> list[tuple[Floats, int]]:
        """Outlines (K, 3) and grey levels, the farthest first."""
        poses, shirt = self._poses, self._shirt
        holder = _person(poses.body[index], poses.left[index], float(poses.height[index]), self._ground_z)
        shapes = [(shape, int(level)) for shape, level in zip(holder, shirt[[0, 0, 1, 2]], strict=True)]
        apex, ways = poses.apex[index], (poses.edge_left[index], poses.edge_right[index])
        board = [(_rectangle(apex, ways, self.drawn.board_m, cell), level) for cell, level in self._levels]
        if self.drawn.blunt_m > 0.0:
            outline, level = board[0]
            cut = np.maximum(0.0, self.drawn.blunt_m - (outline - apex) @ np.transpose(ways))
            is_cut = np.all(cut > 0.0, axis=1)
            ends = apex + self.drawn.blunt_m * np.array(ways)
            board[0] = np.concatenate([ends[1:], ends[:1], outline[~is_cut]]), level
        if self.drawn.rim_m > 0.0 and index % 2:
            outside = (-self.drawn.rim_m / self.drawn.board_m[0], 1.0, 0.0, 1.0)
            board.insert(0, (_rectangle(apex, ways, self.drawn.board_m, outside), (240, 12)[index // 2 % 2]))
        shapes += board + [(shape, int(shirt[2])) for shape in _hands(apex, ways, self.drawn.board_m)]
        if poses.second is None:
            return shapes
        second = poses.second
        other = [
            (shape, int(level))
            for shape, level in zip(
                _person(second.body[index], second.left[index], float(second.height[index]), self._ground_z),
                shirt[[3, 3, 0, 2]],
                strict=True,
            )
        ]
        nearer = np.linalg.norm(second.body[index]) < np.linalg.norm(apex[:2])
        return shapes + other if nearer else other + shapes


def _camera(drawn: Draw, random: np.random.Generator, turn: Floats) -> MountedLens:
    width, height = drawn.size
    f = width * (random.uniform(0.3, 0.6) if drawn.model == "kannala_brandt" else random.uniform(0.5, 1.4))
    values = {
        "f_x": f,
        "f_y": f * (1.0 + random.normal(0.0, 0.003)),
        "c_x": 0.5 * width + random.normal(0.0, 0.01 * width),
        "c_y": 0.5 * height + random.normal(0.0, 0.01 * height),
    }
    corner = 0.5 * math.hypot(width, height) / f
    if drawn.model == "brown_conrady":
        k1 = random.uniform(-0.2, 0.05) / corner**2
        values |= {"k1": k1, "k2": -0.2 * k1 / corner**2, "k3": random.normal(0, 7e-4), "k4": random.normal(0, 7e-4)}
    if drawn.model == "kannala_brandt":
        values |= {"k1": random.uniform(-0.05, 0.02), "k2": random.uniform(-0.01, 0.01)}
    lens = Lens(drawn.model, np.array([values.get(name, 0.0) for name in INTRINSICS[drawn.model]]))
    pitch = random.uniform(-4.0, 14.0) + (random.uniform(8.0, 14.0) if drawn.tip_outside else 0.0)
    tilt = np.radians([random.normal(0.0, 3.0), random.uniform(-25.0, 25.0), pitch])
    about = rotation_from_vector(np.array([0.0, 0.0, tilt[0]])) @ rotation_from_vector(np.array([-tilt[2], 0.0, 0.0]))
    R = about @ FORWARD_LIDAR_TO_OPTICAL @ rotation_from_vector(np.array([0.0, 0.0, tilt[1]]))
    centre = random.uniform((-0.3, -0.4, -0.6), (0.5, 0.4, 0.3))
    return MountedLens(lens, SE3("camera", "lidar", R @ turn.T, -R @ centre))


def _velocity(walk: Walk, times: Floats, drawn: Draw) -> Floats:
    """(N, 3) m/s as a track tells them: the way of a whole second, which errors of 1 cm make uncertain by 14 mm/s."""
    if drawn.still:
        return np.zeros((len(times), 3))
    around = [walk.poses(np.clip(times + half, 0.0, 239.9)).apex for half in (-_HALF_S, _HALF_S)]
    noise = np.random.default_rng([drawn.seed, 45]).normal(0.0, 0.014, (len(times), 3))
    return (around[1] - around[0]) / (2.0 * _HALF_S) + noise


def _corners(poses: Poses) -> dict[CornerName, Floats]:
    left = poses.board_m[0] * poses.edge_left
    right = poses.board_m[1] * poses.edge_right
    return {
        "top": poses.apex,
        "left": poses.apex + left,
        "right": poses.apex + right,
        "bottom": poses.apex + left + right,
    }


def _background(drawn: Draw, random: np.random.Generator) -> NDArray[np.uint8]:
    """Soft texture of several scales, slanted boxes and poles."""
    width, height = drawn.size
    image = np.full((height, width), random.uniform(70.0, 170.0), np.float32)
    for cell in (160, 40, 10, 3):
        grain = random.normal(0.0, drawn.texture / 2.0, (height // cell + 2, width // cell + 2)).astype(np.float32)
        image += np.asarray(cv2.resize(grain, (width, height), interpolation=cv2.INTER_CUBIC), np.float32)
    for _ in range(int(random.uniform(3, 25))):
        middle, half = random.uniform((0, 0), (width, height)), random.uniform(10.0, 0.2 * width, 2)
        box = cv2.boxPoints(
            (middle.tolist(), half.tolist(), float(random.choice([0.0, 90.0, random.uniform(0, 90)])))
        )
        cv2.fillPoly(
            image, [np.rint(box).astype(np.int32)], float(image.mean() + random.normal(0.0, 2.0 * drawn.texture))
        )
    return np.clip(np.rint(image), 1, 254).astype(np.uint8)


def _levels(
    drawn: Draw, random: np.random.Generator, background: NDArray[np.uint8]
) -> list[tuple[tuple[float, float, float, float], int]]:
    """Cells of the board (from, to along the left edge, from, to along the right one, as shares) and grey levels."""
    behind = float(np.median(background))
    sign = (
        -1.0
        if behind + drawn.contrast > 235.0 or (random.uniform() < 0.5 and behind > drawn.contrast + 20.0)
        else 1.0
    )
    base = int(np.clip(behind + sign * drawn.contrast, 3, 252))
    inner = int(np.clip(base + random.choice([-1, 1]) * random.uniform(25.0, 90.0), 3, 252))
    cells = [((0.0, 1.0, 0.0, 1.0), base)]
    if drawn.pattern == "border":
        rim = random.uniform(0.05, 0.15)
        cells.append(((rim, 1.0 - rim, rim, 1.0 - rim), inner))
    if drawn.pattern == "chess":
        m, n = int(random.uniform(4, 9)), int(random.uniform(4, 9))
        cells += [
            ((i / m, (i + 1) / m, j / n, (j + 1) / n), inner) for i in range(m) for j in range(n) if (i + j) % 2 == 0
        ]
    if drawn.pattern == "tag":
        grid = np.linspace(0.15, 0.85, 8)
        bits = random.uniform(size=(7, 7)) < 0.5
        cells += [
            ((grid[i], grid[i + 1], grid[j], grid[j + 1]), inner) for i in range(7) for j in range(7) if bits[i, j]
        ]
    return cells


def _cut(
    drawn: Draw, random: np.random.Generator, levels: list[tuple[tuple[float, float, float, float], int]]
) -> list[tuple[tuple[float, float, float, float], int]]:
    """The cells of a board whose four edges were cut a little off."""
    long = (drawn.board_m[0], drawn.board_m[0], drawn.board_m[1], drawn.board_m[1])
    off = random.normal(0.0, EDGE_SIGMA_M, 4) / long

    def moved(cell: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
        a, b, c, d = (
            value + shift if value in (0.0, 1.0) else value for value, shift in zip(cell, off.tolist(), strict=True)
        )
        return a, b, c, d

    return [(moved(cell), level) for cell, level in levels]


def _rectangle(
    apex: Floats, ways: tuple[Floats, Floats], board_m: tuple[float, float], cell: tuple[float, float, float, float]
) -> Floats:
    a, b, c, d = cell
    corners = np.array([(a, c), (b, c), (b, d), (a, d)]) * board_m
    part = np.arange(_EDGE_STEPS)[:, None] / _EDGE_STEPS
    sides = zip(corners, np.roll(corners, -1, axis=0), strict=True)
    outline = np.concatenate([start + part * (end - start) for start, end in sides])
    return apex + outline[:, :1] * ways[0] + outline[:, 1:] * ways[1]


def _hands(apex: Floats, ways: tuple[Floats, Floats], board_m: tuple[float, float]) -> list[Floats]:
    turn = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)[:, None]
    disc = 0.045 * (np.cos(turn) * ways[0] + np.sin(turn) * ways[1])
    return [apex + 0.6 * board_m[k] * ways[k] + disc for k in range(2)]


def _person(body: Floats, left: Floats, height: float, ground_z: float) -> list[Floats]:
    """Outlines of both legs, the torso and the head."""
    base, side = np.array([body[0], body[1], ground_z]), np.array([left[0], left[1], 0.0])
    turn = np.linspace(0.0, 2.0 * np.pi, 20, endpoint=False)[:, None]

    def box(middle: float, half: float, low: float, high: float) -> Floats:
        places = ((middle - half, low), (middle + half, low), (middle + half, high), (middle - half, high))
        return np.array([base + across * side + up * _UP for across, up in places])

    head = base + (height - 0.105) * _UP + 0.105 * (np.cos(turn) * side + np.sin(turn) * _UP)
    return [
        box(-0.1, 0.08, 0.0, 0.5 * height),
        box(0.1, 0.08, 0.0, 0.5 * height),
        box(0.0, 0.2, 0.48 * height, height - 0.22),
        head,
    ]


def _smeared(image: NDArray[np.float32], moved: Floats) -> NDArray[np.float32]:
    """The image smeared along a way of so many pixels, as a moving board is; the truth is its middle."""
    length = float(np.hypot(*moved))
    if not np.isfinite(length) or length < 0.3:
        return image
    count = int(np.ceil(length * 2.0)) + 1
    shifts = np.linspace(-0.5, 0.5, count)[:, None] * moved
    total = np.zeros_like(image)
    for du, dv in shifts:
        total += cv2.warpAffine(
            image, np.array([[1.0, 0.0, du], [0.0, 1.0, dv]]), image.shape[1::-1], borderMode=cv2.BORDER_REPLICATE
        )
    return total / np.float32(count)
