"""What errors, stated errors and shares come to."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.detection.walks import Found

_GROSS_DEG = 0.3
_FOCAL_PX = 400.0
_BANDS_M = ((4.0, 8.0), (8.0, 13.0), (13.0, 20.0), (20.0, 34.0))


def figures(parts: Sequence[Found]) -> dict[str, Any]:
    """All walks of one detector together: shares of the sweeps in which two rings meet the board, errors, by band."""
    visible = np.concatenate([part.visible for part in parts])
    rows = np.concatenate([part.vertices for part in parts])
    whole = _figures(rows, visible.size)
    if rows.size and not np.isnan(rows[:, 3]).any():
        whole |= _honesty(rows)
        fine = rows[rows[:, 8] == 1.0]
        whole["fine"] = _figures(fine, visible.size) | (_honesty(fine) if fine.size else {})
        whole["flagged_share"] = float(np.mean(rows[:, 9]))
        gross = _total(rows) > _GROSS_DEG
        whole["gross_share_unflagged"] = float(np.mean(gross & (rows[:, 9] == 0.0)))
    whole["by_range"] = {
        f"{low:g}-{high:g} m": _figures(
            rows[(rows[:, 6] >= low) & (rows[:, 6] < high)], int(np.sum((visible >= low) & (visible < high)))
        )
        for low, high in _BANDS_M
    }
    return whole


def _total(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.hypot(rows[:, 0], rows[:, 1])


def _figures(rows: NDArray[np.float64], visible: int) -> dict[str, Any]:
    share = float(np.sum(rows[:, 7])) / max(visible, 1)
    if not len(rows):
        return {"frames": visible, "accepted_share": share}
    total = _total(rows)
    return {
        "frames": visible,
        "accepted_share": share,
        "rms_deg": _rms(total),
        "rms_elevation_deg": _rms(rows[:, 1]),
        "rms_azimuth_deg": _rms(rows[:, 0]),
        "bias_deg": float(np.mean(rows[:, 1])),
        "bias_azimuth_deg": float(np.mean(rows[:, 0])),
        "rms_range_mm": 1e3 * _rms(rows[:, 2]),
        "rms_px": _FOCAL_PX * _rms(np.radians(total)),
        "median_px": _FOCAL_PX * float(np.median(np.radians(total))),
        "gross_share": float(np.mean(total > _GROSS_DEG)),
        "on_fewer_rings_share": float(np.mean(rows[:, 7] == 0.0)),
    }


def _honesty(rows: NDArray[np.float64]) -> dict[str, Any]:
    """Of azimuth and elevation; pooled, and each with the range."""
    scaled = rows[:, :3] / rows[:, 3:6]
    names = ("azimuth", "elevation", "range")
    return {
        "coverage_2sigma": float(np.mean(np.abs(scaled) <= 2.0)),
        "normalised_rms": _rms(scaled[np.isfinite(scaled)]),
        "coverage_2sigma_by_axis": dict(zip(names, np.mean(np.abs(scaled) <= 2.0, axis=0).tolist(), strict=True)),
        "normalised_rms_by_axis": dict(zip(names, np.sqrt(np.mean(scaled**2, axis=0)).tolist(), strict=True)),
    }


def mean_sigma(errors: NDArray[np.float64]) -> float:
    """Standard error of the mean of errors in order of time, which neighbours share.

    Their number counts as N / (1 + 2 times the sum of the autocorrelations before the first that is not positive).
    """
    about = errors - np.mean(errors)
    variance = float(np.mean(about**2))
    if errors.size < 2 or variance == 0.0:
        return 0.0
    shared = 1.0
    for lag in range(1, errors.size // 2):
        correlation = float(about[:-lag] @ about[lag:]) / errors.size / variance
        if correlation <= 0.0:
            break
        shared += 2.0 * correlation
    return math.sqrt(variance * min(shared, errors.size) / errors.size)


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def rounded(value: Any) -> Any:
    """Four significant figures everywhere."""
    if isinstance(value, dict):
        return {key: rounded(item) for key, item in value.items()}
    return float(f"{value:.4g}") if isinstance(value, float) else value
