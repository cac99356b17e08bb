# pyright: reportMissingTypeStubs=false
"""T_cameraA_cameraB from two calibrations of one rig, with its covariance, and its distance from a stated one."""

from collections.abc import Callable
from dataclasses import dataclass
from math import exp, log, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import special

from apexcal.documents.camera_models import ANGLES
from apexcal.documents.results import FitResult
from apexcal.geometry.rotations import vector_from_rotation
from apexcal.geometry.se3 import SE3
from workers.geometry.models import FORM_ID
from workers.solver.problem import FitProblem
from workers.solver.residuals import rotation_axes
from workers.solver.uncertainty import turns_are_free

Floats = NDArray[np.float64]
# scipy publishes no types.
_chi2_tail: Callable[[float, float], float] = special.chdtrc
_normal_quantile_of_log: Callable[[float], float] = special.ndtri_exp
# A direction whose variance is below this share of the largest is known exactly: locks leave such.
_KNOWN: Final = 1e-14


@dataclass(frozen=True, eq=False)
class Deviation:
    """The distance of one transform from another of the same frames.

    rotation_deg and translation_mm are lengths; chi2 is d^T C^-1 d over `freedom` directions, probability the chance
    that noise alone gives as much, sigmas the same chance as a two-sided normal deviate.
    """

    rotation_deg: float
    translation_mm: float
    chi2: float
    freedom: int
    probability: float
    sigmas: float


def mount_covariance(problem: FitProblem, result: FitResult) -> Floats | None:
    """Covariance (6, 6) of a solved mount: small turns about the camera's axes (rad), then t (m); None if unknown.

    result: that of the problem. A locked parameter has no variance. None where the pairs left
    one of the six open. Where a rotation is locked or has a prior, its deviations are of the search's own
    parameters, and are turned about the camera's axes here.
    """
    names = result.covariance.names
    matrix = np.array(result.covariance.matrix, dtype=np.float64).reshape(len(names), len(names))
    local = turns_are_free(problem)
    mount = ("rotation_x", "rotation_y", "rotation_z", *problem.names[3:6]) if local else problem.names[:6]
    if any(name in result.std and result.std[name] is None for name in mount):
        return None
    covariance = np.zeros((6, 6))
    places = [(i, names.index(name)) for i, name in enumerate(mount) if name in names]
    for i, a in places:
        for j, b in places:
            covariance[i, j] = matrix[a, b] * _radians(mount[i]) * _radians(mount[j])
    if local:
        return covariance
    p = np.array([result.polished.parameters[name] for name in problem.names], dtype=np.float64)
    J = np.eye(6)
    J[:3, :3] = rotation_axes(FORM_ID[problem.search], p)
    return J @ covariance @ J.T


def between_cameras(T_a_lidar: SE3, covariance_a: Floats, T_b_lidar: SE3, covariance_b: Floats) -> tuple[SE3, Floats]:
    """T_a_b and its covariance (6, 6): small turns about camera a's axes (rad), then t (m, camera a's frame).

    With R' = exp(d) R in both calibrations, to first order (Barfoot, State Estimation for Robotics, 2017, ch. 7; t is
    kept apart as in the fits): d_ab = d_a - R_ab d_b and t_ab' = t_a' - exp(d_ab) R_ab t_b'. The two fits count as
    independent: their marks are; a vertex seen by both moves both mounts alike, which cancels in part, so that the
    deviations are rather too large than too small.
    """
    T_a_b = T_a_lidar @ T_b_lidar.inverse()
    arm, a = T_a_b.R @ T_b_lidar.t, T_a_b.to_frame
    by_a, by_b = SE3(a, a, t=arm).adjoint(), -SE3(a, T_a_b.from_frame, T_a_b.R, arm).adjoint()
    return T_a_b, by_a @ covariance_a @ by_a.T + by_b @ covariance_b @ by_b.T


def deviation(fitted: SE3, covariance: Floats, stated: SE3, stated_covariance: Floats) -> Deviation:
    """Return how far `fitted` lies from `stated`; covariances (6, 6) as in `between_cameras`, about the same axes.

    A direction that both claim to know exactly (locks) does not count among the sigmas.
    """
    turn = vector_from_rotation(fitted.R @ stated.R.T)
    shift = fitted.t - stated.t
    chi2, freedom = _mahalanobis(np.concatenate([turn, shift]), covariance + stated_covariance)
    probability = float(_chi2_tail(float(freedom), chi2)) if freedom else 1.0
    return Deviation(
        float(np.degrees(np.linalg.norm(turn))),
        float(1e3 * np.linalg.norm(shift)),
        chi2,
        freedom,
        probability,
        normal_sigmas(chi2, freedom),
    )


def normal_sigmas(chi2: float, freedom: int) -> float:
    """The two-sided normal deviate that is as unlikely as a chi-squared value of so many degrees of freedom."""
    if freedom == 0:
        return 0.0
    tail = float(_chi2_tail(float(freedom), chi2))
    # Below the smallest float both tails fall like exp(-x^2 / 2).
    return sqrt(chi2) if tail < exp(-700.0) else max(0.0, -float(_normal_quantile_of_log(log(tail / 2.0))))


def _mahalanobis(d: Floats, covariance: Floats) -> tuple[float, int]:
    # Scaled to equal units first, so that radians and metres weigh alike in what counts as no variance.
    scale = np.sqrt(np.diag(covariance))
    scale[scale == 0.0] = 1.0
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    determined = values > _KNOWN * max(float(values[-1]), 1.0)
    along = vectors[:, determined].T @ (d / scale)
    return float(np.sum(along * along / values[determined])), int(np.count_nonzero(determined))


def _radians(name: str) -> float:
    return float(np.radians(1.0)) if name in ANGLES else 1.0
