"""The two detectors that look at the highest ring alone.

``strict`` is Algorithm 1 of Lyu et al. 2019; ``tolerant`` is what the authors' released toolbox does. If the ground
tells that the sensor hangs upside down, the highest ring is the one of the lowest number.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.detectors import Options
from workers.readers.recording import Sweep
from workers.vertices.sweep_source import Area, OnSweep, Run, SweepSource
from workers.vertices.upside_down import hanging
from workers.vertices.vertex import Answers, Rejection, Vertex


@dataclass(frozen=True, slots=True)
class _Candidates:
    """The points of one sweep inside the region: (N, 3) metres, (N,) ring (upwards), (N,) ns after the stamp."""

    xyz: NDArray[np.float64]
    ring: NDArray[np.int64]
    offset_ns: NDArray[np.int64]


_Select = Callable[[_Candidates, Options], NDArray[np.bool_] | Rejection]


def _strict(inside: _Candidates, options: Options) -> NDArray[np.bool_] | Rejection:
    """Algorithm 1: ring span (max - min) at least 3, exactly one point on the highest ring."""
    if inside.ring.size == 0:
        return Rejection("no_points")
    top = int(inside.ring.max())
    if top - int(inside.ring.min()) < options["min_ring_span"]:
        return Rejection("ring_span_too_small")
    on_top = inside.ring == top
    return on_top if np.count_nonzero(on_top) == 1 else Rejection("top_ring_not_single")


def _tolerant(inside: _Candidates, options: Options) -> NDArray[np.bool_] | Rejection:
    """The authors' toolbox: few points on the top ring, close together, and a board below them."""
    if inside.ring.size == 0:
        return Rejection("no_points")
    if inside.ring.size < options["min_points"]:
        return Rejection("too_few_points")
    top = int(inside.ring.max())
    on_top = inside.ring == top
    if np.count_nonzero(on_top) > options["max_top_points"]:
        return Rejection("top_ring_too_wide")
    apart = inside.xyz[on_top][:, None, :] - inside.xyz[on_top][None, :, :]
    if float(np.linalg.norm(apart, axis=2).max()) > options["max_spread_m"]:
        return Rejection("top_points_apart")
    if np.count_nonzero(inside.ring == top - 2) < options["min_points_two_below"]:
        return Rejection("too_few_points_two_rings_below")
    return on_top


def _look(
    detector: str, select: _Select, sweep: Sweep, area: Area, options: Options, index: int, upwards: int
) -> Vertex | Rejection:
    chosen = np.flatnonzero(area.inside(sweep))
    inside = _Candidates(
        sweep.xyz[chosen].astype(np.float64),
        upwards * sweep.ring[chosen].astype(np.int64),
        sweep.offset_ns[chosen].astype(np.int64),
    )
    selected = select(inside, options)
    if isinstance(selected, Rejection):
        return selected
    x, y, z = inside.xyz[selected].mean(axis=0).tolist()
    return Vertex(
        xyz=(x, y, z),
        time_ns=sweep.stamp_ns + round(float(inside.offset_ns[selected].mean())),
        ring=upwards * int(inside.ring[selected][0]),
        sweep_index=index,
        points_used=int(np.count_nonzero(selected)),
        detector=detector,
    )


def _runner(detector: str, select: _Select) -> Run:
    def run(source: SweepSource, area: Area, options: Options, indices: range, on_sweep: OnSweep) -> Answers:
        upwards = 1 if hanging(source) is None else -1
        outcomes: list[Vertex | Rejection] = []
        for index in indices:
            outcomes.append(_look(detector, select, source.sweep(index), area, options, index, upwards))
            on_sweep(index)
        return Answers(outcomes)

    return run


run_strict = _runner("strict", _strict)
run_tolerant = _runner("tolerant", _tolerant)
