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
# Cells of the image, and how much nearer than an edge something in its cell must be to hide it from the camera.
_CELLS: Final = 24
_NEARER: Final = 1.3
# Regions of the image that take turns among the groups.
_REGIONS: Final = (10, 6)
# Edges of a frame that are looked at, and how far beside the image they may lie, in focal lengths (15 degrees).
_MOST_EDGES: Final = 4000
_BESIDE: Final = 0.27


class EdgeFrame(NamedTuple):
    """A frame and what its LiDAR saw, at the frame's moment.

    Attributes:
        points, beyond: (N, 3) depth edges as :class:`DepthEdges` has them, metres, LiDAR frame.
        group: (N,) groups whose errors are independent: regions of the image.
        cloud: (M, 3) all points in view.
        maps: (2, h, w) bytes: gradients across u and v.
        scale: pixels of the maps that make one of the calibration.
    """

    points: Floats
    beyond: Floats
    group: NDArray[np.int64]
    cloud: Floats
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
        chosen = np.flatnonzero(is_near)
        if len(chosen) > _MOST_EDGES:
            chosen = np.sort(np.random.default_rng(0).choice(chosen, _MOST_EDGES, replace=False))
        cell = np.clip(pixels[chosen] / calibration.image_size, 0.0, 0.999) * _REGIONS
        column, row = cell.astype(np.int64).T
        group = (row * _REGIONS[0] + column) % MOST_GROUPS
        maps = np.clip(UNIT * edge_image(image), 0.0, 255.0).astype(np.uint8)
        in_view = cloud[_near(calibration, cloud, beside)[1]]
        scale = image.shape[1] / calibration.image_size[0]
        return cls(points[chosen], beyond[chosen], group, in_view, maps, scale)

    def made_smaller(self, pixel_rad: float, focal_px: float) -> EdgeFrame:
        """The same with maps whose pixels are so large, if theirs are smaller."""
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
        is_visible[is_visible] = ~self._hidden(calibration, points[is_visible], pixels[is_visible])
        pixels = pixels[is_visible]
        across = np.abs(far_pixels[is_visible] - pixels)
        across /= np.maximum(np.linalg.norm(across, axis=1), 1e-9)[:, None]
        return ImageParts(pixels, calibration.jacobians(points[is_visible])[0], across, group[is_visible])

    def _hidden(self, calibration: KnownCalibration, points: Floats, pixels: Floats) -> NDArray[np.bool_]:
        """Which points something nearer may hide from the camera, which stands elsewhere than the LiDAR."""
        where, is_visible = calibration.project(self.cloud)
        size = calibration.image_size[0] / _CELLS
        rows = int(calibration.image_size[1] / size) + 2

        def cell(pixels: Floats) -> NDArray[np.int64]:
            column, row = np.floor((pixels + 0.5) / size).astype(np.int64).T
            return (row + 1) * (_CELLS + 2) + column + 1

        nearest = np.full((rows + 1) * (_CELLS + 2), np.inf)
        depth = calibration.mount.apply(self.cloud[is_visible])[:, 2]
        np.minimum.at(nearest, cell(where[is_visible]), depth)
        own = calibration.mount.apply(points)[:, 2]
        return own > _NEARER * nearest[cell(pixels)]


def _near(calibration: KnownCalibration, points: Floats, beside_px: float) -> tuple[Floats, NDArray[np.bool_]]:
    """Pixels (N, 2) of points, and which of them lie in the image or so far beside it."""
    camera = calibration.mount.apply(points)
    pixels = calibration.project(points)[0]
    size = np.array(calibration.image_size)
    near = np.isfinite(pixels).all(axis=1) & (camera[:, 2] > 0.0)
    with np.errstate(invalid="ignore"):
        near &= ((pixels > -beside_px) & (pixels < size + beside_px)).all(axis=1)
    return pixels, near
