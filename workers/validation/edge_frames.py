"""Frames of a drive with the depth edges of their moments, ready to be compared under any mount."""

from __future__ import annotations

from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from workers.readers.recording import Sweep
from workers.validation.calibration import KnownCalibration
from workers.validation.depth_edges import depth_edges
from workers.validation.edge_image import edge_image
from workers.validation.motion import STANDING, Motion
from workers.validation.offsets import MOST_GROUPS, ImageParts

Floats = NDArray[np.float64]

# A gradient of its surroundings' strength, as a byte of a map.
UNIT: Final = 24.0
# Cells across the image, and how much nearer than an edge something in its cell must be to hide it from the camera.
_CELLS: Final = 24
_NEARER: Final = 1.3
# How wide an image's edge is, with its blur and the beam's: what is less well placed by the LiDAR tells less.
_WIDTH_RAD: Final = np.radians(0.25)
# Regions of the image that take turns among the groups.
_REGIONS: Final = (10, 6)
# Edges of a frame that are looked at, and how far beside the image they may lie, in focal lengths (15 degrees).
_MOST_EDGES: Final = 4000
_BESIDE: Final = 0.27


class EdgeFrame(NamedTuple):
    """A frame and what its LiDAR saw, at the frame's moment.

    Attributes:
        points, beyond: (N, 3) depth edges as :class:`DepthEdges` has them, metres, LiDAR frame; without those that
            something nearer hides from the camera, which stands elsewhere than the LiDAR.
        group: (N,) groups whose errors are independent: regions of the image.
        maps: (2, h, w) bytes: gradients across u and v.
        weight: (N,) what an edge tells: a half, where the directions it lies between are as far apart as it is wide.
        scale: pixels of the maps that make one of the calibration.
    """

    points: Floats
    beyond: Floats
    group: NDArray[np.int64]
    weight: Floats
    maps: NDArray[np.uint8]
    scale: float

    @classmethod
    def of(
        cls, calibration: KnownCalibration, sweep: Sweep, image: NDArray[np.uint8], motion: Motion = STANDING
    ) -> EdgeFrame:
        """A sweep and the frame (h, w), grey, of the moment to which `motion` moves its points."""
        edges = depth_edges(sweep)
        points, beyond = (motion.applied(ends, edges.offset_ns) for ends in (edges.points, edges.beyond))
        cloud = motion.applied(sweep.xyz.astype(np.float64), sweep.offset_ns)
        beside = _BESIDE * float(calibration.intrinsics[0])
        pixels, is_near = _near(calibration, points, beside)
        is_near &= ~_hidden(calibration, points, cloud)
        chosen = np.flatnonzero(is_near)
        if len(chosen) > _MOST_EDGES:
            chosen = np.sort(np.random.default_rng(0).choice(chosen, _MOST_EDGES, replace=False))
        cell = np.clip(pixels[chosen] / calibration.image_size, 0.0, 0.999) * _REGIONS
        column, row = cell.astype(np.int64).T
        group = (row * _REGIONS[0] + column) % MOST_GROUPS
        maps = np.clip(UNIT * edge_image(image), 0.0, 255.0).astype(np.uint8)
        scale = image.shape[1] / calibration.image_size[0]
        points, beyond = points[chosen], beyond[chosen]
        gap = 2.0 * np.linalg.norm(beyond - points, axis=1) / np.linalg.norm(points, axis=1)
        return cls(points, beyond, group, _WIDTH_RAD / (_WIDTH_RAD + gap), maps, scale)

    def made_smaller(self, pixel_rad: float, focal_px: float) -> EdgeFrame:
        """Return the frame with its maps reduced to pixels of ``pixel_rad``, if theirs are smaller."""
        factor = 1.0 / (self.scale * focal_px * pixel_rad)
        if factor >= 1.0:
            return self
        _, height, width = self.maps.shape
        size = (max(round(width * factor), 8), max(round(height * factor), 8))
        layers = [np.asarray(cv2.resize(layer, size, interpolation=cv2.INTER_AREA), np.uint8) for layer in self.maps]
        maps = np.stack(layers)
        return self._replace(maps=maps, scale=self.scale * size[0] / width)

    def parts(self, calibration: KnownCalibration, every: int = 1) -> ImageParts:
        """The edges that a camera of that calibration sees, or each so-many-th of them."""
        points, beyond, group = self.points[::every], self.beyond[::every], self.group[::every]
        pixels, is_visible = calibration.project(points)
        far_pixels = calibration.project(beyond)[0]
        is_visible &= np.isfinite(far_pixels).all(axis=1)
        pixels = pixels[is_visible]
        across = np.abs(far_pixels[is_visible] - pixels)
        across *= (self.weight[::every][is_visible] / np.maximum(np.linalg.norm(across, axis=1), 1e-9))[:, None]
        return ImageParts(pixels, calibration.jacobians(points[is_visible])[0], across, group[is_visible])


def _hidden(calibration: KnownCalibration, points: Floats, cloud: Floats) -> NDArray[np.bool_]:
    """(N,) which points something nearer may hide from the camera. A turn of the mount changes nothing of it."""
    size = calibration.image_size[0] / calibration.intrinsics[0] / _CELLS

    def cells(points: Floats) -> tuple[NDArray[np.int64], Floats]:
        x, y, z = calibration.mount.apply(points).T
        column, row = np.floor(np.arctan2(x, z) / size), np.floor(np.arctan2(y, np.hypot(x, z)) / size)
        return (row * 1000 + column).astype(np.int64), np.sqrt(x * x + y * y + z * z)

    (cell, own), (of_cloud, distance) = cells(points), cells(cloud)
    numbers, index = np.unique(np.concatenate([cell, of_cloud]), return_inverse=True)
    nearest = np.full(len(numbers), np.inf)
    np.minimum.at(nearest, index[len(points) :], distance)
    return own > _NEARER * nearest[index[: len(points)]]


def _near(calibration: KnownCalibration, points: Floats, beside_px: float) -> tuple[Floats, NDArray[np.bool_]]:
    """Pixels (N, 2) of points, and which of them lie in the image or so far beside it."""
    camera = calibration.mount.apply(points)
    pixels = calibration.project(points)[0]
    size = np.array(calibration.image_size)
    near = np.isfinite(pixels).all(axis=1) & (camera[:, 2] > 0.0)
    with np.errstate(invalid="ignore"):
        near &= ((pixels > -beside_px) & (pixels < size + beside_px)).all(axis=1)
    return pixels, near
