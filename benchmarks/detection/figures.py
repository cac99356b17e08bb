"""What errors, stated errors and shares come to."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.detection.walks import Found

_GROSS_DEG = 0.3


def figures(parts: Sequence[Found]) -> dict[str, Any]:
    """All walks of one detector together: shares of the sweeps in which two rings meet the board, and errors."""
    visible = sum(part.visible.size for part in parts)
    rows = np.concatenate([part.vertices for part in parts])
    share = float(np.sum(rows[:, 7])) / max(visible, 1)
    if not len(rows):
        return {"frames": visible, "accepted_share": share}
    total = np.hypot(rows[:, 0], rows[:, 1])
    answer = {
        "frames": visible,
        "vertices": len(rows),
        "accepted_share": share,
        "rms_deg": _rms(total),
        "bias_deg": float(np.mean(rows[:, 1])),
        "bias_azimuth_deg": float(np.mean(rows[:, 0])),
        "rms_range_mm": 1e3 * _rms(rows[:, 2]),
        "gross_share": float(np.mean(total > _GROSS_DEG)),
    }
    if np.isnan(rows[:, 3]).any():
        return answer
    scaled = rows[:, :3] / rows[:, 3:6]
    return answer | {
        "coverage_2sigma": float(np.mean(np.abs(scaled) <= 2.0)),
        "chi_square": float(np.mean(scaled**2)),
    }


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def rounded(value: Any) -> Any:
    """Four significant figures everywhere."""
    if isinstance(value, dict):
        return {key: rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [rounded(item) for item in value]
    return float(f"{value:.4g}") if isinstance(value, float) else value
