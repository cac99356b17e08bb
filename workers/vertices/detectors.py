"""The detectors of the board's apex by name, and the one way to run them: one vertex or a reason per sweep.

On a walk, what stands still (walls, cars and signs) can be no board.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.detectors import DetectorName, Options, parse_detector, resolve_options
from workers.readers.recording import Sweep
from workers.vertices import ring_rules
from workers.vertices.backdrop import Backdrop
from workers.vertices.pose_detection import detect_poses
from workers.vertices.refined.run import run as run_refined
from workers.vertices.region import Region
from workers.vertices.seam import find_cut, run_cut
from workers.vertices.still_poses import find_poses
from workers.vertices.sweep_source import OnSweep, Run, SweepSource, stamp_of
from workers.vertices.vertex import Answers, Detections, Vertex

Mask = NDArray[np.bool_]

# The largest board is 1.8 m wide. Carried at 0.3 m/s, it has left its place after 6 s.
_LEAST_S: Final = 6.0
_COMPARED: Final = 16


@dataclass(frozen=True, slots=True, eq=False)
class WithoutFixed:
    """A region without the objects that stand still over a whole walk."""

    region: Region
    backdrop: Backdrop

    @property
    def fixed_left_out(self) -> bool:
        """See `sweep_source.Area`."""
        return True

    def inside(self, sweep: Sweep) -> Mask:
        """Which points (N,) of a sweep lie in the region and on nothing that stands still."""
        inside = self.region.mask(sweep.xyz)
        return inside & ~self.backdrop.fixed(sweep, inside) if inside.any() else inside


def without_fixed(
    source: SweepSource, region: Region, on_sweep: Callable[[], None] | None = None
) -> Region | WithoutFixed:
    """The region without fixed objects; as it is where the recording is too short to tell them."""
    count = len(source)
    if count < _COMPARED or stamp_of(source, count - 1) - stamp_of(source, 0) < _LEAST_S * 1e9:
        return region
    return WithoutFixed(region, Backdrop.of(source, _COMPARED, on_sweep))


RUNS: dict[DetectorName, Run] = {
    "strict": ring_rules.run_strict,
    "tolerant": ring_rules.run_tolerant,
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
    """Look for the apex in some consecutive sweeps of a recording.

    The answer for a sweep does not depend on how the recording is cut into ranges: what a detector learns across
    sweeps comes from a fixed selection over the whole source, and what uses the track reads beyond the range's ends.

    Args:
        source: the whole recording.
        name: a name in :data:`RUNS`.
        options: numbers that differ from the defaults of :mod:`apexcal.documents.detectors`.
        indices: consecutive rising numbers of sweeps of ``source``.
        on_sweep: called now and then with the number of a sweep of ``indices``, never a smaller one than before:
            that many are done. It may raise to stop the work.
        margin: how many sweeps before and after are looked at too, for ``context``.
        still: the owner says that these are still poses; it is noticed otherwise, too.

    Raises:
        DocumentError: ``unknown_detector``, ``invalid_options``.
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
    poses = find_poses(source, region, stated=still, on_sweep=lambda: report(indices.start))
    cut = find_cut(source, region) if poses is None else None
    if cut is not None:
        answers = run_cut(source, region, cut, walk, resolved, wider, report)
    elif poses is None:
        answers = walk(source, region, resolved, wider, report)
    else:
        answers = detect_poses(source, region, poses, RUNS[detector], resolved, wider, report)
    for index, answer in zip(wider, answers.found, strict=True):
        if isinstance(answer, Vertex):
            (vertices if index in indices else context).append(answer)
        elif index in indices:
            refused[index] = answer.reason
    rejected = dict(sorted(Counter(refused.values()).items()))
    facts = None if poses is None else poses.facts()
    return Detections(vertices, len(indices), rejected, tuple(context), refused, facts, answers.size)
