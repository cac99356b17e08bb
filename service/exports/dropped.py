"""The effect of lens terms that a format's readers leave out, in pixels where the calibration's pairs lie."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np

from apexcal.documents.checks import figure
from apexcal.geometry.se3 import Floats
from service.exports.calibrated import CalibratedCamera

_ITERATIONS = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-14)


class Dropped(NamedTuple):
    """The camera without the terms, and how far that moves the pixels of the pairs."""

    camera: CalibratedCamera
    max_px: float
    median_px: float

    @property
    def sentence(self) -> str:
        """Say in a sentence how far the pixels move."""
        return f"up to {figure(self.max_px)} px, in the median {figure(self.median_px)} px, where pairs lie"


def drop(camera: CalibratedCamera, terms: list[str]) -> Dropped:
    """The lens, a ``brown_conrady``, with these parameters at 0."""
    lens = {name: 0.0 if name in terms else value for name, value in camera.intrinsics.items()}
    less = replace(camera, intrinsics=lens)
    moved = np.linalg.norm(_through(camera, less, camera.marked) - camera.marked, axis=1)
    return Dropped(less, float(moved.max()), float(np.median(moved)))


def _through(camera: CalibratedCamera, less: CalibratedCamera, pixels: Floats) -> Floats:
    """Return pixels (n, 2) by the second ``brown_conrady`` lens of points that the first shows at pixels (n, 2)."""
    rays = np.c_[pixels, np.ones(len(pixels))] @ np.linalg.inv(np.array(camera.K)).T
    eye, zero = np.eye(3), np.zeros(3)
    points = cv2.undistortPoints(rays[:, None, :2].copy(), eye, np.array(camera.D), criteria=_ITERATIONS)
    points = np.c_[points[:, 0], np.ones(len(pixels))]
    distorted = cv2.projectPoints(points, zero, zero, eye, np.array(less.D))[0][:, 0]
    return np.c_[distorted, np.ones(len(pixels))] @ np.array(less.K)[:2].T
