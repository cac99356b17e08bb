"""The detectors of the board's apex by name, and the one way to run them: each sweep gets a vertex or a reason.

``strict`` is Algorithm 1 of Lyu et al. 2019; ``tolerant`` is what the authors' released toolbox does: both look at
the highest ring alone. ``refined`` fits a board (`board`). On a walk the static background (walls, cars and signs)
can be no board and is left out first.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.detectors import (
    MOST_SIGMA_DEG,
    MOST_UPPER_SIGMA_DEG,
    DetectorName,
    Options,
    parse_detector,
    resolve_options,
)
from workers.readers.recording import Sweep
from workers.vertices.board.refined import run as run_refined
from workers.vertices.cut_angle import find_cut, run_cut
from workers.vertices.pose_detection import detect_poses
from workers.vertices.region import Region
from workers.vertices.ringless import run_ringless
from workers.vertices.sensor_grid import some_grid
from workers.vertices.static_background import FIXED_SHARE, Foreground, StaticBackground
from workers.vertices.still_poses import find_poses
from workers.vertices.sweep_source import Area, OnSweep, Run, SweepSource, any_rings, stamp_of
from workers.vertices.vertex import Answers, Detections, Rejection, Vertex


@dataclass(frozen=True, slots=True)
class _Candidates:
    """The points of one sweep inside the region: (N, 3) metres, (N,) ring (upwards), (N,) ns after the stamp."""

    xyz: NDArray[np.float64]
    ring: NDArray[np.int64]
    offset_ns: NDArray[np.int64]


_Select = Callable[[_Candidates, Options], NDArray[np.bool_] | Rejection]


def _strict(inside: _Candidates, options: Options) -> NDArray[np.bool_] | Rejection:
    """Return the single point of the highest ring, if the rings span at least 3 (Algorithm 1)."""
    if inside.ring.size == 0:
        return Rejection("no_points")
    top = int(inside.ring.max())
    if top - int(inside.ring.min()) < options["min_ring_span"]:
        return Rejection("ring_span_too_small")
    on_top = inside.ring == top
    return on_top if np.count_nonzero(on_top) == 1 else Rejection("top_ring_not_single")


def _tolerant(inside: _Candidates, options: Options) -> NDArray[np.bool_] | Rejection:
    """Return the points of the top ring if they are few, close together and have a board below them, as the authors'
    toolbox does.
    """
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


def _find_vertex(
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
        upwards = -1 if some_grid(source).R_level_lidar[2, 2] < 0.0 else 1
        outcomes: list[Vertex | Rejection] = []
        for index in indices:
            outcomes.append(_find_vertex(detector, select, source.sweep(index), area, options, index, upwards))
            on_sweep(index)
        return Answers(outcomes)

    return run


run_strict = _runner("strict", _strict)
run_tolerant = _runner("tolerant", _tolerant)


Mask = NDArray[np.bool_]

# The largest board is 1.8 m wide. Carried at 0.3 m/s, it has left its place after 6 s.
_LEAST_S: Final = 6.0
_COMPARED: Final = 16


def without_fixed(
    source: SweepSource, region: Region, on_sweep: Callable[[], None] | None = None
) -> Region | Foreground:
    """Return the region without static background; unchanged if the recording is too short to show it."""
    count = len(source)
    if count < _COMPARED or stamp_of(source, count - 1) - stamp_of(source, 0) < _LEAST_S * 1e9:
        return region
    background = StaticBackground.of(source, _COMPARED, on_sweep)
    return Foreground.of(region, background, FIXED_SHARE)


RUNS: dict[DetectorName, Run] = {
    "strict": run_strict,
    "tolerant": run_tolerant,
    "refined": run_refined,
}


def detect_range(
    source: SweepSource,
    region: Region,
    name: str,
    options: Mapping[str, Any] | None = None,
    *,
    indices: range,
    on_sweep: OnSweep | None = None,
    margin: int = 0,
    still: bool = False,
) -> Detections:
    """Return the vertices, or the reasons for none, of some consecutive sweeps of a recording.

    The answer for a sweep does not depend on how the recording is cut into ranges: what a detector learns across
    sweeps comes from a fixed selection over the whole source, and what uses the track reads beyond the range's ends.

    Args:
        source: the whole recording.
        name: a name in :data:`RUNS`.
        options: numbers that differ from the defaults of :mod:`apexcal.documents.detectors`.
        indices: consecutive rising numbers of sweeps of ``source``.
        on_sweep: called now and then with the index of a sweep of ``indices``, never a smaller one than before.
            Sweeps up to it are done. It may raise to stop the work.
        margin: how many sweeps before and after are looked at, too, for ``context``.
        still: the owner says that these are still poses; otherwise the sweeps themselves may show it.

    Raises:
        DocumentError: ``unknown_detector``, ``invalid_options``, ``points_without_rings``.
        ValueError: ``indices`` are not consecutive sweeps of the source.
    """
    detector = parse_detector(name)
    resolved = resolve_options(detector, options)
    if indices.step != 1 or indices.start < 0 or (indices and indices.stop > len(source)):
        raise ValueError(f"indices must be consecutive and within 0 to {len(source) - 1}, got {indices}")
    if not indices:
        return Detections([], 0, {})
    wider = range(max(0, indices.start - margin), min(len(source), indices.stop + margin))

    def report(index: int) -> None:
        if on_sweep is not None:
            on_sweep(min(max(index, indices.start), indices.stop - 1))

    def walk(source: SweepSource, region: Region, options: Options, indices: range, on_sweep: OnSweep) -> Answers:
        area = without_fixed(source, region, lambda: on_sweep(indices.start)) if detector == "refined" else region
        return RUNS[detector](source, area, options, indices, on_sweep)

    vertices: list[Vertex] = []
    context: list[Vertex] = []
    refused: dict[int, str] = {}
    best: dict[str, tuple[int, str]] = {}
    has_rings = detector != "refined" or any_rings(source)
    poses = find_poses(source, region, stated=still, on_sweep=lambda: report(indices.start)) if has_rings else None
    cut = find_cut(source, region) if poses is None and has_rings else None
    facts = None if poses is None else poses.facts()
    if resolved.get("max_sigma_deg") == 0.0:
        is_upper_in_poses = poses is not None and resolved["upper_corner"]
        resolved["max_sigma_deg"] = MOST_UPPER_SIGMA_DEG if is_upper_in_poses else MOST_SIGMA_DEG
    if not has_rings:
        answers, facts = run_ringless(source, region, resolved, wider, still, report)
    elif cut is not None:
        answers = run_cut(source, region, cut, walk, resolved, wider, report)
    elif poses is None:
        answers = walk(source, region, resolved, wider, report)
    else:
        answers = detect_poses(source, region, poses, RUNS[detector], resolved, wider, report)
    for index, answer in zip(wider, answers.outcomes, strict=True):
        if isinstance(answer, Vertex):
            # Nothing moves during a still pose, so its frame is the one nearest to its sweep's stamp.
            timed = answer if facts is None else replace(answer, time_ns=stamp_of(source, answer.sweep_index))
            (vertices if index in indices else context).append(timed)
        elif index in indices:
            refused[index] = answer.reason
            if answer.points > best.get(answer.reason, (0, ""))[0]:
                best[answer.reason] = answer.points, f"sweep {index}: {answer.example}"
    rejected = dict(sorted(Counter(refused.values()).items()))
    examples = {reason: example for reason, (_, example) in best.items()}
    return Detections(vertices, len(indices), rejected, tuple(context), refused, facts, answers.size, examples)
