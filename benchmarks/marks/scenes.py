"""Walks and still poses with a board in front of one camera, drawn wide and rendered with sub-pixel truth.

Whatever stands in a frame is painted on a canvas of 8 times the resolution without anti-aliasing and averaged over
areas: cv2's LINE_AA would grow every edge by 0.6 px. Frame of a scene: x forward, y left, z up, metres, the LiDAR at
the origin; the LiDAR's own frame is turned about z by any angle, so that there is no nominal mount.
"""

from __future__ import annotations

import math
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from apexcal.documents.corners import CornerName
from apexcal.documents.simulation import Disturbances
from apexcal.geometry.rotations import FORWARD_LIDAR_TO_OPTICAL, rotation_from_vector
from apexcal.geometry.se3 import SE3
from benchmarks.marks.draws import Draw
from benchmarks.marks.painting import background, board_levels, cut_cells, hands, person, rectangle, smeared
from tests.support.scenes.held_board import BoardHold, HeldWalk
from workers.geometry.models import INTRINSICS
from workers.geometry.spherical import to_xyz
from workers.marks.sights import Image, Lens, MountedLens, Sight
from workers.simulation.walker import Poses, Walk

Floats = NDArray[np.float64]
OVERSAMPLE: Final = 8
_MASK_PX: Final = 1.5  # of the unsharp mask: its lobes are 3 px away, as in the crops
_HALF_S: Final = 0.5  # `REACH_NS` of the pairs' velocities


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
                rolled_deg=45.0 * drawn.upper_corner + float(random.uniform(-12.0, 12.0)),
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
        self._background = background(drawn, random)
        self._levels = cut_cells(drawn, random, board_levels(drawn, random, self._background))
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
            image = smeared(image, self._moved[index])
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
        shapes = person(second.body[index], second.left[index], float(second.height[index]), self._ground_z)
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
        holder = person(poses.body[index], poses.left[index], float(poses.height[index]), self._ground_z)
        shapes = [(shape, int(level)) for shape, level in zip(holder, shirt[[0, 0, 1, 2]], strict=True)]
        apex, ways = poses.apex[index], (poses.edge_left[index], poses.edge_right[index])
        board = [(rectangle(apex, ways, self.drawn.board_m, cell), level) for cell, level in self._levels]
        if self.drawn.blunt_m > 0.0:
            outline, level = board[0]
            cut = np.maximum(0.0, self.drawn.blunt_m - (outline - apex) @ np.transpose(ways))
            is_cut = np.all(cut > 0.0, axis=1)
            ends = apex + self.drawn.blunt_m * np.array(ways)
            board[0] = np.concatenate([ends[1:], ends[:1], outline[~is_cut]]), level
        if self.drawn.rim_m > 0.0 and index % 2:
            outside = (-self.drawn.rim_m / self.drawn.board_m[0], 1.0, 0.0, 1.0)
            board.insert(0, (rectangle(apex, ways, self.drawn.board_m, outside), (240, 12)[index // 2 % 2]))
        shapes += board + [(shape, int(shirt[2])) for shape in hands(apex, ways, self.drawn.board_m)]
        if poses.second is None:
            return shapes
        second = poses.second
        other = [
            (shape, int(level))
            for shape, level in zip(
                person(second.body[index], second.left[index], float(second.height[index]), self._ground_z),
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
