"""The detectors of the board's apex by name, and the one way to run them: one vertex or a reason per sweep."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from workers.vertices import ring_rules
from workers.vertices.options import DetectorError, Options, overlay
from workers.vertices.refined import offer as refined
from workers.vertices.refined.run import run as run_refined
from workers.vertices.region import Region
from workers.vertices.sources import OnSweep, Run, SweepSource
from workers.vertices.vertex import Detections, Vertex


@dataclass(frozen=True, slots=True)
class Detector:
    """A detector as it is offered: what it does, its options as a JSON schema, its reasons to reject.

    Attributes:
        reasons: name -> sentence, why a sweep gives no vertex.
        run: looks at a range of sweeps; called through :func:`detect_range`.
    """

    name: str
    summary: str
    options_schema: Mapping[str, Any]
    reasons: Mapping[str, str]
    run: Run


DETECTORS: dict[str, Detector] = {
    "strict": Detector(
        name="strict",
        summary="Exactly one point on the highest ring (Algorithm 1 of the paper).",
        options_schema=ring_rules.STRICT_OPTIONS,
        reasons=ring_rules.STRICT_REASONS,
        run=ring_rules.run_strict,
    ),
    "tolerant": Detector(
        name="tolerant",
        summary="One to three points close together on the highest ring; their mean (the authors' toolbox).",
        options_schema=ring_rules.TOLERANT_OPTIONS,
        reasons=ring_rules.TOLERANT_REASONS,
        run=ring_rules.run_tolerant,
    ),
    "refined": Detector(
        name="refined",
        summary="The corner of the plane that the rays meet and miss; with its covariance.",
        options_schema=refined.OPTIONS,
        reasons=refined.REASONS,
        run=run_refined,
    ),
}


def find_detector(name: str) -> Detector:
    """The detector of that name; raises DetectorError ``detector_unknown`` listing the names there are."""
    if name not in DETECTORS:
        raise DetectorError("detector_unknown", f"there is no detector {name!r}", f"One of: {', '.join(DETECTORS)}.")
    return DETECTORS[name]


def resolve_options(detector: Detector, options: Mapping[str, Any] | None) -> Options:
    """Defaults overlaid with ``options``, checked against the detector's schema.

    Raises:
        DetectorError: ``detector_option_unknown`` or ``detector_option_invalid``.
    """
    return overlay(detector.name, detector.options_schema, options)


def detect_range(
    source: SweepSource,
    region: Region,
    name: str,
    options: Mapping[str, Any] | None = None,
    *,
    indices: range,
    on_sweep: OnSweep | None = None,
    margin: int = 0,
) -> Detections:
    """Look for the apex in some consecutive sweeps of a recording.

    The answer for a sweep does not depend on how the recording is cut into ranges: what a detector learns across
    sweeps comes from a fixed selection over the whole source, and what uses the track reads beyond the range's ends.

    Args:
        source: the whole recording.
        name: a name in :data:`DETECTORS`.
        options: numbers that differ from the defaults in the detector's ``options_schema``.
        indices: consecutive rising numbers of sweeps of ``source``.
        on_sweep: called now and then with the number of a sweep of ``indices``, never a smaller one than before:
            that many are done. It may raise to stop the work.
        margin: how many sweeps before and after are looked at too, for ``context``.

    Raises:
        DetectorError: unknown detector or bad option.
        ValueError: ``indices`` are not consecutive sweeps of the source.
    """
    detector = find_detector(name)
    resolved = resolve_options(detector, options)
    if indices.step != 1 or indices.start < 0 or (indices and indices.stop > len(source)):
        raise ValueError(f"indices must be consecutive and within 0 to {len(source) - 1}, got {indices}")
    if not indices:
        return Detections([], 0, {})
    wider = range(max(0, indices.start - margin), min(len(source), indices.stop + margin))

    def report(index: int) -> None:
        if on_sweep is not None:
            on_sweep(min(max(index, indices.start), indices.stop - 1))

    vertices: list[Vertex] = []
    context: list[Vertex] = []
    rejected: Counter[str] = Counter()
    for index, found in zip(wider, detector.run(source, region, resolved, wider, report), strict=True):
        if isinstance(found, Vertex):
            (vertices if index in indices else context).append(found)
        elif index in indices:
            rejected[found.reason] += 1
    return Detections(vertices, len(indices), dict(sorted(rejected.items())), tuple(context))
