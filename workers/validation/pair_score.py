"""A calibration tested on pairs that it was not fitted to: errors, bias, and whether its deviations hold.

Residuals of sound pairs are e = J d + n: d the calibration's own error, with the stated covariance C, n the noise of
marks. The mount's apparent error is A e, where A is the least squares inverse of the mount's columns of J; its
covariance under what is stated is A (J C J^T + sigma^2 I) A^T.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy import special

from apexcal.documents.errors import GeometryError
from workers.geometry.projection import distances_px, image_diagonal_px, project
from workers.validation.calibration import KnownCalibration

Floats = NDArray[np.float64]
# scipy publishes no types.
# pyright: reportMissingTypeStubs=false
_chi2_beyond: Callable[[float, float], float] = special.chdtrc

# A wrong mark: farther from the typical residual than this many robust deviations (one sound mark in 270,000).
_WRONG: Final = 5.0
_MAD: Final = 1.4826
# A sound result is accused once in a thousand times.
_LEVEL: Final = 0.001
# Below these many pairs a robust noise means nothing.
_FEWEST: Final = 8
# A bias below this never accuses: a person's own is 0.3 px (benchmarks/coverage/marks.py).
_FINE_PX: Final = 0.5
# The same ratio as an objection to a result's own held-out pairs.
_UNEXPLAINED: Final = 1.5
# The same share of wrong marks as stops a result (`workers/judge/pair_checks.py`).
_MOST_WRONG: Final = 0.25


def score_pairs(calibration: KnownCalibration, points: Floats, marks: Floats) -> dict[str, Any]:
    """Errors on pairs: points (N, 3), metres, LiDAR frame; marks (N, 2), px. Nothing is fitted.

    Returns `pairs`, `forbidden` (no projection), `wrong` (marks far from all others), `mean_px`, `rms_px`,
    `median_px`, `max_px` over all pairs; `bias_px` (projection minus mark, without wrong marks) and its stated
    deviation `bias_sigma_px`; `noise_px` per coordinate and `stated_noise_px`; `turn_deg`, `shift_mm`: the small
    mount error that the residuals look like, `sigmas` its root mean square in what is stated; `verdict` (`agrees`,
    `disagrees`, `unknown`), `sentence`; columns `u`, `v`, `residual_u`, `residual_v` (null without projection) and
    `is_wrong`.

    Raises:
        GeometryError: `no_pairs`.
    """
    if not len(points):
        raise GeometryError("no_pairs", "There are no pairs to score.", "")
    projected, violation = project(calibration.model, calibration.intrinsics, calibration.mount.apply(points))
    errors = distances_px(projected, violation, marks, image_diagonal_px(calibration.image_size))
    there = violation == 0.0
    residuals = projected - marks
    sound = there & _near_the_others(residuals, there)
    score: dict[str, Any] = {
        "pairs": len(points),
        "forbidden": int(np.count_nonzero(~there)),
        "wrong": int(np.count_nonzero(there & ~sound)),
        "mean_px": float(np.mean(errors)),
        "rms_px": float(np.sqrt(np.mean(errors**2))),
        "median_px": float(np.median(errors)),
        "max_px": float(np.max(errors)),
        "stated_noise_px": calibration.sigma_px,
        **_held_against(calibration, points[sound], residuals[sound]),
    }
    score["verdict"], score["sentence"] = _judged(score)
    columns = {"u": marks[:, 0], "v": marks[:, 1], "residual_u": residuals[:, 0], "residual_v": residuals[:, 1]}
    for name, values in columns.items():
        score[name] = [round(value, 4) if np.isfinite(value) else None for value in values.tolist()]
    score["is_wrong"] = (there & ~sound).tolist()
    return score


def _near_the_others(residuals: Floats, there: NDArray[np.bool_]) -> NDArray[np.bool_]:
    if not there.any():
        return there
    middle = np.median(residuals[there], axis=0)
    spread = np.maximum(_MAD * np.median(np.abs(residuals[there] - middle), axis=0), 1e-6)
    with np.errstate(invalid="ignore"):
        return np.all(np.abs(residuals - middle) < _WRONG * spread, axis=1)


def _held_against(calibration: KnownCalibration, points: Floats, residuals: Floats) -> dict[str, Any]:
    """Bias, noise and the mount's apparent error of sound residuals (N, 2), each with what is stated of it."""
    names = ("bias_px", "bias_sigma_px", "noise_px", "turn_deg", "shift_mm", "sigmas", "probability")
    none: dict[str, Any] = dict.fromkeys(names)
    count = len(points)
    if count < _FEWEST:
        return none
    by_mount, by_stated = (J.reshape(2 * count, -1) for J in calibration.jacobians(points))
    e = residuals.reshape(-1)
    # Translations and turns differ in size by orders of magnitude.
    scale = np.linalg.norm(by_mount, axis=0)
    A = np.asarray(np.linalg.pinv(by_mount / scale, rcond=1e-8), np.float64) / scale[:, None]
    d = A @ e
    left = (e - by_mount @ d).reshape(count, 2)
    freedom = max(2 * count - by_mount.shape[1], 1)
    noise = float(np.sqrt(np.sum(left**2) / freedom))
    score = none | {
        "bias_px": [float(value) for value in residuals.mean(axis=0)],
        "noise_px": noise,
        # The calibration lies d beyond where the pairs would have it.
        "turn_deg": float(np.degrees(np.linalg.norm(d[:3]))),
        "shift_mm": float(1e3 * np.linalg.norm(d[3:])),
    }
    if not calibration.names or calibration.sigma_px is None:
        return score
    # What the pairs show of their own noise counts where it is more than stated: it is judged by itself.
    sigma = max(calibration.sigma_px, noise)
    mean = by_stated.reshape(count, 2, -1).mean(axis=0)
    of_bias = np.diag(mean @ calibration.covariance @ mean.T) + sigma**2 / count
    spread = A @ by_stated
    V = spread @ calibration.covariance @ spread.T + sigma**2 * A @ A.T
    size: Floats = np.sqrt(np.diag(V))
    unit: Floats = np.asarray(V, np.float64) / (size[:, None] * size[None, :])
    apart: Floats = np.asarray(d, np.float64) / size
    statistic = float(np.einsum("i,ij,j->", apart, np.linalg.inv(unit), apart))
    return score | {
        "bias_sigma_px": [float(value) for value in np.sqrt(of_bias)],
        "sigmas": float(np.sqrt(statistic / len(d))),
        "probability": float(_chi2_beyond(len(d), statistic)),
    }


def _judged(score: dict[str, Any]) -> tuple[str, str]:
    """The verdict, and it in a sentence with its reasons."""
    pairs, noise, stated = score["pairs"], score["noise_px"], score["stated_noise_px"]
    errors = f"{pairs} pairs lie {score['mean_px']:.2f} px off on average, {score['median_px']:.2f} px in the median"
    if noise is None:
        return "unknown", f"{errors}: too few for a verdict, which needs {_FEWEST} sound pairs."
    bias = float(np.hypot(*score["bias_px"]))
    if score["sigmas"] is None:
        return "unknown", f"{errors}, with a bias of {bias:.2f} px. The calibration states no standard deviations."
    moved = (
        f"a mount error of {score['turn_deg']:.2f} degrees and {score['shift_mm']:.0f} mm explains them best "
        f"({score['sigmas']:.1f} standard deviations)"
    )
    shares = score["forbidden"] + score["wrong"]
    reasons: list[str] = []
    if score["probability"] < _LEVEL and bias > _FINE_PX:
        reasons.append(f"their bias is {bias:.2f} px, and {moved}")
    elif score["probability"] < _LEVEL and score["median_px"] > max(_UNEXPLAINED * 1.18 * stated, _FINE_PX):
        reasons.append(moved)
    if noise > max(_UNEXPLAINED * stated, _FINE_PX):
        reasons.append(f"their noise is {noise:.2f} px per coordinate, and {stated:.2f} px is stated")
    far = f"{shares} of them have no projection or lie far from all others"
    if shares > _MOST_WRONG * pairs:
        reasons.append(far)
    if reasons:
        return "disagrees", f"The calibration does not hold on these pairs: {errors}; {'; '.join(reasons)}."
    return "agrees", (
        f"The calibration holds on these pairs: {errors}, with a noise of {noise:.2f} px per coordinate "
        f"({stated:.2f} stated); {moved}{f'; {far}' if shares else ''}."
    )
