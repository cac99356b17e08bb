"""What a format's readers leave out of a lens, in pixels where the calibration's pairs lie."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np

from apexcal.documents.camera_models import DECENTRING
from apexcal.documents.checks import figure
from apexcal.geometry.rotations import rotation_from_vector
from apexcal.geometry.se3 import SE3, Floats
from service.exports.calibrated import CalibratedCamera

_ITERATIONS = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-14)


class Dropped(NamedTuple):
    """The camera without the terms, and how far that moves the pixels of the pairs. turned_deg: its mount."""

    camera: CalibratedCamera
    max_px: float
    median_px: float
    turned_deg: float = 0.0

    @property
    def sentence(self) -> str:
        """How far, in words."""
        turned = (
            f"and a mount turned by {figure(self.turned_deg)} degrees. That moves pixels " if self.turned_deg else ""
        )
        return f"{turned}up to {figure(self.max_px)} px, in the median {figure(self.median_px)} px, where pairs lie"


def drop(camera: CalibratedCamera, terms: list[str]) -> Dropped:
    """The lens, a ``brown_conrady``, with these parameters at 0."""
    lens = {name: 0.0 if name in terms else value for name, value in camera.intrinsics.items()}
    less = replace(camera, intrinsics=lens)
    moved = np.linalg.norm(_through(camera, less, camera.marked) - camera.marked, axis=1)
    return Dropped(less, float(moved.max()), float(np.median(moved)))


def _through(camera: CalibratedCamera, less: CalibratedCamera, pixels: Floats) -> Floats:
    """Where the points that one ``brown_conrady`` lens shows at the pixels (n, 2) lie through the other."""
    rays = np.c_[pixels, np.ones(len(pixels))] @ np.linalg.inv(np.array(camera.K)).T
    eye, zero = np.eye(3), np.zeros(3)
    points = cv2.undistortPoints(rays[:, None, :2].copy(), eye, np.array(camera.D), criteria=_ITERATIONS)
    points = np.c_[points[:, 0], np.ones(len(pixels))]
    distorted = cv2.projectPoints(points, zero, zero, eye, np.array(less.D))[0][:, 0]
    return np.c_[distorted, np.ones(len(pixels))] @ np.array(less.K)[:2].T


_FISHEYE = ("f_x", "f_y", "c_x", "c_y", "k1", "k2", "k3", "k4")
_ELSEWHERE = 0.03
_STEPS = np.array([1e-6] * 3 + [1e-3] * 4 + [1e-6] * 4)


def centred(camera: CalibratedCamera) -> Dropped:
    """The fisheye and the turned mount that come nearest to a decentred one where pairs lie: both belong together.

    A turn about the camera's centre moves pixels alike at all distances, so that it can stand for decentring.
    """
    k = np.array([float(camera.intrinsics[name]) for name in _FISHEYE])
    p1, p2 = (float(camera.intrinsics.get(name, 0.0)) for name in DECENTRING)
    grid = np.stack(np.meshgrid(np.linspace(0, camera.width - 1, 17), np.linspace(0, camera.height - 1, 11)), -1)
    pixels = np.concatenate([camera.marked, grid.reshape(-1, 2)])
    bent = (pixels - k[2:4]) / k[:2]
    theta = np.linspace(0.0, np.pi, 20001)
    grown = _grown(theta, k)
    end = int(np.argmax(np.diff(grown) <= 0.0)) or len(theta) - 1
    plane, length = bent, np.linalg.norm(bent, axis=1)
    for _ in range(20):
        a, b = plane.T
        s = a * a + b * b
        across, down = 2.0 * p1 * a * b + p2 * (s + 2.0 * a * a), p1 * (s + 2.0 * b * b) + 2.0 * p2 * a * b
        radial = bent - np.stack([across, down], 1)
        length = np.maximum(np.linalg.norm(radial, axis=1), 1e-12)
        plane = radial * (np.interp(length, grown[: end + 1], theta[: end + 1]) / length)[:, None]
    is_seen = length < grown[end]
    angle = np.maximum(np.linalg.norm(plane, axis=1), 1e-12)
    rays = np.column_stack([plane * (np.sin(angle) / angle)[:, None], np.cos(angle)])
    # Pairs may leave a lens open that other parts of the image then hold.
    weight = np.where(np.arange(len(pixels)) < len(camera.marked), 1.0, _ELSEWHERE)[is_seen, None]
    v = np.concatenate([np.zeros(3), k])
    for _ in range(15):
        pairs = [(_fisheye(v + step, rays), _fisheye(v - step, rays)) for step in np.diag(_STEPS)]
        J = np.stack([(weight * (ahead - behind)[is_seen]).ravel() for ahead, behind in pairs], 1)
        off = (weight * (pixels - _fisheye(v, rays))[is_seen]).ravel()
        v = v + _STEPS * np.linalg.lstsq(0.5 * J, off)[0]
    moved = np.linalg.norm(_fisheye(v, rays) - pixels, axis=1)[: len(camera.marked)]
    T, turn = camera.T_camera_lidar, rotation_from_vector(v[:3])
    turned = SE3(T.to_frame, T.from_frame, turn @ T.R, turn @ T.t)
    lens = dict(zip(_FISHEYE, v[3:].tolist(), strict=True)) | dict.fromkeys(DECENTRING, 0.0)
    less = replace(camera, intrinsics=lens, T_camera_lidar=turned)
    return Dropped(less, float(moved.max()), float(np.median(moved)), float(np.degrees(np.linalg.norm(v[:3]))))


def _grown(theta: Floats, k: Floats) -> Floats:
    s = theta * theta
    return theta * (1.0 + s * (k[4] + s * (k[5] + s * (k[6] + s * k[7]))))


def _fisheye(v: Floats, rays: Floats) -> Floats:
    """Pixels (n, 2) of rays (n, 3) that are turned by v[:3], through the fisheye v[3:]."""
    x, y, z = rotation_from_vector(v[:3]) @ rays.T
    r = np.maximum(np.hypot(x, y), 1e-12)
    grown = _grown(np.arctan2(r, z), v[3:]) / r
    return np.stack([v[3] * x * grown + v[5], v[4] * y * grown + v[6]], 1)
