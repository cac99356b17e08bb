"""Errors in the sensor's own axes (azimuth, elevation, range) and in x, y, z."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def axes(xyz: Floats) -> Floats:
    """(N, 3, 3): column j is how a point (N, 3) moves, in metres, per radian of azimuth, of elevation, per metre."""
    x, y, z = xyz[..., 0], xyz[..., 1], xyz[..., 2]
    flat = np.maximum(np.hypot(x, y), 1e-9)
    distance = np.maximum(np.linalg.norm(xyz, axis=-1), 1e-9)
    nought = np.zeros_like(x)
    return np.stack(
        [
            np.stack([-y, x, nought], axis=-1),
            np.stack([-z * x / flat, -z * y / flat, flat], axis=-1),
            xyz / distance[..., None],
        ],
        axis=-1,
    )


def to_xyz(covariance: Floats, xyz: Floats) -> Floats:
    """Covariances (N, 3, 3) over (azimuth rad, elevation rad, range m) of points (N, 3), over x, y, z, m^2."""
    J = axes(xyz)
    return J @ covariance @ J.swapaxes(-1, -2)


def to_spherical(covariance: Floats, xyz: Floats) -> Floats:
    """The inverse of `to_xyz`."""
    J = np.linalg.inv(axes(xyz))
    return J @ covariance @ J.swapaxes(-1, -2)
