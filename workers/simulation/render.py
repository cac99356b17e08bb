"""Paints the walker and the board into camera frames, sub-pixel exact where the truth matters: the board.

`cv2.fillPoly` with LINE_AA grows every edge by 0.6 px, so the figure is painted on a canvas of 8 times the
resolution without anti-aliasing, and the canvas is averaged down over areas.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from workers.simulation.camera import SimulatedCamera
from workers.simulation.figure import Colour, Shape, figure, pole
from workers.simulation.scene import Scene
from workers.simulation.walker import Poses

_OVERSAMPLE = 8  # a power of two
_JPEG_QUALITY = 85
_FAR_PX = 20_000
_SHIFT = 4  # cv2's fixed point: 1/16 of a canvas pixel


def encode_jpeg(image: NDArray[np.uint8]) -> bytes:
    """JPEG with colour at full resolution: the board's edges are edges of colour as much as of brightness."""
    sampling = [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY, *sampling])
    return data.tobytes()


class Renderer:
    """Frames of one camera over a background that was painted once; ``colour`` changes that of each shape."""

    def __init__(
        self,
        camera: SimulatedCamera,
        scene: Scene,
        background: NDArray[np.uint8],
        colour: Callable[[Colour], Colour] = lambda colour: colour,
    ) -> None:
        self._camera = camera
        self._centre = camera.centre()
        self._scene = scene
        self._background = background
        self._colour = colour

    def frame(self, poses: Poses, index: int) -> NDArray[np.uint8]:
        """The frame (height, width, 3) uint8 BGR of the pose with that index."""
        shapes = self._seen(figure(poses, index, self._scene.ground_z, self._centre))
        image = self._background.copy()
        if not shapes:
            return image
        corners = np.concatenate([pixels for pixels, _ in shapes])
        width, height = self._camera.image_size
        left, top = np.maximum(np.floor(corners.min(axis=0)).astype(int) - 1, 0).tolist()
        right, bottom = np.minimum(np.ceil(corners.max(axis=0)).astype(int) + 2, (width, height)).tolist()
        if left < right and top < bottom:
            _blend(image[top:bottom, left:right], [*shapes, *self._before(poses.apex[index])], left, top)
        return image

    def _seen(self, shapes: Sequence[Shape]) -> list[Shape]:
        """The shapes in pixels; those that the lens cannot see are left out."""
        coloured = ((points, self._colour(colour)) for points, colour in shapes)
        projected = ((self._camera.project(points), colour) for points, colour in coloured if colour[3])
        # Not a number fails the comparison too; what projects far outside of the image is beside or behind the lens.
        return [(pixels, colour) for pixels, colour in projected if bool((np.abs(pixels) < _FAR_PX).all())]

    def _before(self, apex: NDArray[np.float64]) -> list[Shape]:
        """The poles that stand nearer than the board: what they hide of it is painted over."""
        far = np.linalg.norm(self._scene.poles[:, :2] - self._centre[:2], axis=1)
        nearer = self._scene.poles[far < np.linalg.norm(apex[:2] - self._centre[:2])]
        return self._seen([shape for row in nearer for shape in pole(row, self._scene.ground_z, self._centre)])


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
