"""Paints the walker and the board into camera frames, sub-pixel exact where the truth matters: the board.

`cv2.fillPoly` with LINE_AA grows every edge by 0.6 px, so the figure is painted on a canvas of 8 times the
resolution without anti-aliasing, and the canvas is averaged down over areas.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from workers.simulation.camera import Camera
from workers.simulation.scene import Scene
from workers.simulation.walker import (
    HEAD_RADIUS_M,
    LEG_APART_M,
    LEG_RADIUS_M,
    TORSO_RADIUS_M,
    Poses,
)

_OVERSAMPLE = 8  # a power of two
_JPEG_QUALITY = 85
_SHIFT = 4  # cv2's fixed point: 1/16 of a canvas pixel
_STEPS = 12  # points per board edge: a straight edge is a curve behind the lens

Colour = tuple[int, int, int, int]  # BGR premultiplied with alpha, alpha
Shape = tuple[NDArray[np.float64], Colour]

_SHADOW: Colour = (0, 0, 0, 80)
_TROUSERS: Colour = (84, 58, 44, 255)
_JACKET: Colour = (70, 92, 40, 255)
_SLEEVE: Colour = (60, 80, 34, 255)
_SKIN: Colour = (142, 170, 214, 255)
_HAIR: Colour = (34, 42, 58, 255)
_BOARD: Colour = (24, 150, 250, 255)
_BOARD_INSET: Colour = (60, 196, 255, 255)


def encode_jpeg(image: NDArray[np.uint8]) -> bytes:
    """JPEG with colour at full resolution: the board's edges are edges of colour as much as of brightness."""
    sampling = [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY, *sampling])
    return data.tobytes()


class Renderer:
    """Frames of one camera over a background that was painted once."""

    def __init__(self, camera: Camera, scene: Scene, background: NDArray[np.uint8]) -> None:
        self._camera = camera
        self._ground_z = scene.ground_z
        self._background = background

    def frame(self, poses: Poses, index: int) -> NDArray[np.uint8]:
        """The frame (height, width, 3) uint8 BGR of the pose with that index."""
        shapes = self._shapes(poses, index)
        image = self._background.copy()
        if not shapes:
            return image
        corners = np.concatenate([pixels for pixels, _ in shapes])
        width, height = self._camera.image_size
        left, top = np.maximum(np.floor(corners.min(axis=0)).astype(int) - 1, 0).tolist()
        right, bottom = np.minimum(np.ceil(corners.max(axis=0)).astype(int) + 2, (width, height)).tolist()
        if left < right and top < bottom:
            _blend(image[top:bottom, left:right], shapes, left, top)
        return image

    def _shapes(self, poses: Poses, index: int) -> list[Shape]:
        """What to paint, the farthest first, in pixels; shapes that the lens cannot see are left out."""
        shapes = [*self._body(poses, index), *self._board(poses, index), *self._hands(poses, index)]
        projected = ((self._camera.project(points), colour) for points, colour in shapes)
        return [(pixels, colour) for pixels, colour in projected if bool(np.isfinite(pixels).all())]

    def _body(self, poses: Poses, index: int) -> list[Shape]:
        body, left, height = poses.body[index], poses.left[index], float(poses.height[index])
        base = np.array([body[0], body[1], self._ground_z])
        side = np.array([left[0], left[1], 0.0])
        up = np.array([0.0, 0.0, 1.0])
        hip, neck = 0.47 * height, height - 2.2 * HEAD_RADIUS_M
        turn = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)[:, None]
        ring = np.cos(turn) * np.array([1.0, 0.0, 0.0]) + np.sin(turn) * np.array([0.0, 1.0, 0.0])
        shapes: list[Shape] = [(base + (0.25, 0.0, 0.0) + 0.42 * ring, _SHADOW)]
        for sign in (-1.0, 1.0):
            leg = base + sign * LEG_APART_M * side
            shapes.append((_limb(leg, leg + (hip + 0.05) * up, side, LEG_RADIUS_M), _TROUSERS))
        shapes.append((_torso(base, side, hip, neck), _JACKET))
        head = base + (height - HEAD_RADIUS_M) * up
        disc = np.cos(turn) * side + np.sin(turn) * up
        shapes.append((head + HEAD_RADIUS_M * disc, _HAIR))
        shapes.append((head - 0.025 * up + 0.85 * HEAD_RADIUS_M * disc, _SKIN))
        for sign, grip in zip((1.0, -1.0), _grips(poses, index), strict=True):
            shoulder = base + sign * 1.15 * TORSO_RADIUS_M * side + (neck - 0.08) * up
            shapes.append((_limb(shoulder, grip, _across(shoulder, grip, side), 0.045), _SLEEVE))
        return shapes

    def _board(self, poses: Poses, index: int) -> list[Shape]:
        apex, edge_left, edge_right = poses.apex[index], poses.edge_left[index], poses.edge_right[index]
        return [
            (_rectangle(apex, edge_left, edge_right, poses.board_m, 0.0), _BOARD),
            (_rectangle(apex, edge_left, edge_right, poses.board_m, 0.09), _BOARD_INSET),
        ]

    def _hands(self, poses: Poses, index: int) -> list[Shape]:
        turn = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)[:, None]
        disc = np.cos(turn) * poses.edge_left[index] + np.sin(turn) * poses.edge_right[index]
        return [(grip + 0.04 * disc, _SKIN) for grip in _grips(poses, index)]


def _grips(poses: Poses, index: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where the hands hold the board: on the middle of its upper edges."""
    apex = poses.apex[index]
    return (
        apex + 0.6 * poses.board_m[0] * poses.edge_left[index],
        apex + 0.5 * poses.board_m[1] * poses.edge_right[index],
    )


def _across(start: NDArray[np.float64], end: NDArray[np.float64], side: NDArray[np.float64]) -> NDArray[np.float64]:
    """A unit vector in the plane of side and up, at right angles to a limb."""
    along = end - start
    wide, high = float(along @ side), float(along[2])
    norm = max(np.hypot(wide, high), 1e-6)
    return (high * side - wide * np.array([0.0, 0.0, 1.0])) / norm


def _limb(
    start: NDArray[np.float64], end: NDArray[np.float64], across: NDArray[np.float64], radius: float
) -> NDArray[np.float64]:
    offset = radius * across
    return np.array([start - offset, start + offset, end + offset, end - offset])


def _torso(base: NDArray[np.float64], side: NDArray[np.float64], hip: float, neck: float) -> NDArray[np.float64]:
    up = np.array([0.0, 0.0, 1.0])
    outline = (
        (-1.0, hip - 0.06),
        (1.0, hip - 0.06),
        (1.25, neck - 0.08),
        (0.5, neck),
        (-0.5, neck),
        (-1.25, neck - 0.08),
    )
    return np.array([base + TORSO_RADIUS_M * wide * side + high * up for wide, high in outline])


def _rectangle(
    apex: NDArray[np.float64],
    edge_left: NDArray[np.float64],
    edge_right: NDArray[np.float64],
    board_m: tuple[float, float],
    inset: float,
) -> NDArray[np.float64]:
    """Outline (4 * _STEPS, 3) of the board, or of the field ``inset`` metres inside it."""
    low, (high_left, high_right) = inset, (edge - inset for edge in board_m)
    corners = np.array([(low, low), (high_left, low), (high_left, high_right), (low, high_right)])
    part = np.arange(_STEPS)[:, None] / _STEPS
    outline = np.concatenate(
        [
            corner + part * (following - corner)
            for corner, following in zip(corners, np.roll(corners, -1, 0), strict=True)
        ]
    )
    return apex + outline[:, :1] * edge_left + outline[:, 1:] * edge_right


def _blend(crop: NDArray[np.uint8], shapes: Sequence[Shape], left: int, top: int) -> None:
    """Paint the shapes (pixels of the whole image) over ``crop``, whose first pixel is (left, top)."""
    height, width = crop.shape[:2]
    canvas = np.zeros((height * _OVERSAMPLE, width * _OVERSAMPLE, 4), np.uint8)
    for pixels, colour in shapes:
        # Pixel centres are at whole numbers, in the image and on the canvas.
        fine = (pixels - (left, top) + 0.5) * _OVERSAMPLE - 0.5
        fixed = np.round(fine * (1 << _SHIFT)).astype(np.int32)
        cv2.fillPoly(canvas, [fixed], colour, lineType=cv2.LINE_8, shift=_SHIFT)
    while canvas.shape[0] > height:  # halving is the fast case of INTER_AREA: 4 times faster than 8 at once
        half = (canvas.shape[1] // 2, canvas.shape[0] // 2)
        canvas = np.asarray(cv2.resize(canvas, half, interpolation=cv2.INTER_AREA), np.uint8)
    paint = canvas.astype(np.float32)
    mixed = paint[..., :3] + crop * (1.0 - paint[..., 3:] / 255.0)
    crop[:] = np.clip(np.round(mixed), 0.0, 255.0).astype(np.uint8)
