"""LiDAR-to-camera calibration: a client of the service, its command, and :func:`fit` without a service."""

from apexcal.fitting import fit

__all__ = ["fit"]
