"""Where the marks lie in the image and in the field, and what is missing."""

from __future__ import annotations

from itertools import groupby
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from workers.geometry.models import parse_model
from workers.geometry.projection import unproject
from workers.reports.material import Material
from workers.reports.pair_errors import PairErrors

Floats = NDArray[np.float64]
COLUMNS: Final = 6
# Bands of range: the paper's field ends at 30 m.
BANDS_M: Final = (0.0, 6.0, 12.0, 20.0, 30.0)


class CoverageGrid(NamedTuple):
    """The number of pairs (B, C) by band of range and by sector: edges (C+1,) right of the axis, (B+1,)."""

    edges_deg: Floats
    edges_m: Floats
    pairs: NDArray[np.int64]


def field_of(material: Material, errors: PairErrors) -> CoverageGrid:
    """The pairs by horizontal angle in the camera's view and by range."""
    lens = material.chosen.result.intrinsics
    width, height = lens.image_size
    u = np.linspace(-0.5, width - 0.5, COLUMNS + 1)
    rays, _ = unproject(parse_model(lens.model), lens.by_name(), np.column_stack([u, np.full(len(u), 0.5 * height)]))
    angles = np.degrees(np.arctan2(rays[:, 0], rays[:, 2]))
    column = np.clip(np.searchsorted(u, material.pairs["u"], side="right") - 1, 0, COLUMNS - 1)
    edges = np.array([*BANDS_M, max(float(errors.range_m.max()) + 1.0, BANDS_M[-1] + 10.0)])
    band = np.clip(np.searchsorted(edges, errors.range_m, side="right") - 1, 0, len(edges) - 2)
    count = np.zeros((len(edges) - 1, COLUMNS), np.int64)
    np.add.at(count, (band, column), 1)
    return CoverageGrid(angles, edges, count)


def missing(field: CoverageGrid) -> list[str]:
    """Sentences about sectors without pairs, one for each band; nothing beyond the farthest pair."""
    sentences: list[str] = []
    farthest = int(np.flatnonzero(field.pairs.sum(axis=1))[-1])
    for band in range(farthest + 1):
        row = field.pairs[band]
        where = f"between {field.edges_m[band]:.0f} and {field.edges_m[band + 1]:.0f} m"
        if not row.any():
            sentences.append(f"Nothing {where}.")
            continue
        for empty, columns in groupby(range(COLUMNS), key=lambda column: row[column] == 0):
            if empty:
                run = list(columns)
                sentences.append(
                    f"Nothing {_sector(field.edges_deg[run[0]], field.edges_deg[run[-1] + 1], run)} {where}."
                )
    return sentences


def _sector(low: float, high: float, run: list[int]) -> str:
    if run[-1] == COLUMNS - 1:
        return f"right of {low:.0f} degrees"
    if run[0] == 0:
        return f"left of {high:.0f} degrees"
    return f"between {low:.0f} and {high:.0f} degrees"
