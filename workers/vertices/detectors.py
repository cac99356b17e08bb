"""The detectors of the board's apex: one vertex, or the reason why there is none, per sweep.

``strict`` is Algorithm 1 of Lyu et al. 2019; ``tolerant`` is what the authors' released toolbox does.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workers.geometry.errors import InputError
from workers.readers.recording import Sweep
from workers.vertices.region import Region

Options = Mapping[str, float]


class DetectorError(InputError):
    """A detector or an option that is not known or out of its limits.

    Codes: ``detector_unknown``, ``detector_option_unknown``, ``detector_option_invalid``.
    """


@dataclass(frozen=True, slots=True)
class Vertex:
    """The board's apex as one sweep saw it.

    Attributes:
        xyz: metres, LiDAR frame.
        time_ns: UTC nanoseconds, when the vertex point itself was measured (mean where there are several).
        ring: ring of the vertex point, 0 the lowest.
        sweep_index: number of the sweep in its recording.
        points_used: how many points were averaged.
        detector: name in :data:`DETECTORS`.
    """

    xyz: tuple[float, float, float]
    time_ns: int
    ring: int
    sweep_index: int
    points_used: int
    detector: str


@dataclass(frozen=True, slots=True)
class Rejection:
    """Why a sweep gave no vertex: a stable name from its detector's ``reasons``."""

    reason: str


@dataclass(frozen=True, slots=True)
class Candidates:
    """The points of one sweep inside the region: (N, 3) metres, (N,) ring, (N,) ns after the stamp."""

    stamp_ns: int
    xyz: NDArray[np.float64]
    ring: NDArray[np.int64]
    offset_ns: NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Detector:
    """A detector as it is offered: what it does, its options as a JSON schema, and its reasons to reject."""

    name: str
    summary: str
    options_schema: Mapping[str, Any]
    reasons: Mapping[str, str]
    select: Callable[[Candidates, Options], NDArray[np.bool_] | Rejection]


@dataclass(frozen=True, slots=True)
class Detections:
    """All vertices of a recording in sweep order, and how many sweeps were rejected for each reason."""

    vertices: list[Vertex]
    frames: int
    rejected: dict[str, int]


def _strict(inside: Candidates, options: Options) -> NDArray[np.bool_] | Rejection:
    """Algorithm 1: ring span (max - min) at least 3, exactly one point on the highest ring."""
    if inside.ring.size == 0:
        return Rejection("no_points")
    top = int(inside.ring.max())
    if top - int(inside.ring.min()) < options["min_ring_span"]:
        return Rejection("ring_span_too_small")
    on_top = inside.ring == top
    return on_top if np.count_nonzero(on_top) == 1 else Rejection("top_ring_not_single")


def _tolerant(inside: Candidates, options: Options) -> NDArray[np.bool_] | Rejection:
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


def _schema(**options: tuple[str, float, float, float, str]) -> dict[str, Any]:
    """JSON schema of number options: name -> (type, default, minimum, maximum, description)."""
    names = ("type", "default", "minimum", "maximum", "description")
    return {
        "type": "object",
        "additionalProperties": False,
        "properties": {key: dict(zip(names, value, strict=True)) for key, value in options.items()},
    }


DETECTORS: dict[str, Detector] = {
    "strict": Detector(
        name="strict",
        summary="Exactly one point on the highest ring (Algorithm 1 of the paper).",
        options_schema=_schema(
            min_ring_span=("integer", 3, 1, 127, "highest minus lowest ring that has points in the region"),
        ),
        reasons={
            "no_points": "no point of the sweep lies in the region",
            "ring_span_too_small": "the rings in the region span too few to be a person with a board",
            "top_ring_not_single": "more than one point on the highest ring",
        },
        select=_strict,
    ),
    "tolerant": Detector(
        name="tolerant",
        summary="One to three points close together on the highest ring; their mean (the authors' toolbox).",
        options_schema=_schema(
            min_points=("integer", 10, 1, 100_000, "points in the region"),
            max_top_points=("integer", 3, 1, 1000, "points on the highest ring"),
            max_spread_m=("number", 0.05, 0.0, 10.0, "largest distance between points on the highest ring"),
            min_points_two_below=("integer", 3, 0, 1000, "points two rings below the highest"),
        ),
        reasons={
            "no_points": "no point of the sweep lies in the region",
            "too_few_points": "too few points of the sweep lie in the region",
            "top_ring_too_wide": "too many points on the highest ring",
            "top_points_apart": "the points on the highest ring are too far apart",
            "too_few_points_two_rings_below": "too few points two rings below the highest",
        },
        select=_tolerant,
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
    properties: Mapping[str, Mapping[str, Any]] = detector.options_schema["properties"]
    resolved: dict[str, float] = {key: schema["default"] for key, schema in properties.items()}
    for key, value in (options or {}).items():
        if key not in properties:
            raise DetectorError(
                "detector_option_unknown",
                f"detector {detector.name!r} has no option {key!r}",
                f"Its options: {', '.join(properties)}.",
            )
        schema = properties[key]
        kinds = int if schema["type"] == "integer" else int | float
        is_number = isinstance(value, kinds) and not isinstance(value, bool)
        if not is_number or not schema["minimum"] <= value <= schema["maximum"]:
            raise DetectorError(
                "detector_option_invalid",
                f"option {key!r} of detector {detector.name!r} cannot be {value!r}",
                f"Give a {schema['type']} between {schema['minimum']} and {schema['maximum']}.",
            )
        resolved[key] = value
    return resolved


def detect(
    name: str,
    sweep: Sweep,
    region: Region,
    options: Mapping[str, Any] | None = None,
    *,
    sweep_index: int = 0,
) -> Vertex | Rejection:
    """Look for the apex in one sweep.

    Args:
        name: a name in :data:`DETECTORS`.
        options: numbers that differ from the defaults in the detector's ``options_schema``.

    Raises:
        DetectorError: unknown detector or bad option.
    """
    detector = find_detector(name)
    return _detect(detector, resolve_options(detector, options), sweep, region, sweep_index)


def _detect(
    detector: Detector, options: Options, sweep: Sweep, region: Region, sweep_index: int
) -> Vertex | Rejection:
    index = np.flatnonzero(region.mask(sweep.xyz))
    inside = Candidates(
        sweep.stamp_ns,
        sweep.xyz[index].astype(np.float64),
        sweep.ring[index].astype(np.int64),
        sweep.offset_ns[index].astype(np.int64),
    )
    selected = detector.select(inside, options)
    if isinstance(selected, Rejection):
        return selected
    x, y, z = inside.xyz[selected].mean(axis=0).tolist()
    return Vertex(
        xyz=(x, y, z),
        time_ns=inside.stamp_ns + round(float(inside.offset_ns[selected].mean())),
        ring=int(inside.ring[selected][0]),
        sweep_index=sweep_index,
        points_used=int(np.count_nonzero(selected)),
        detector=detector.name,
    )


def detect_all(
    sweeps: Iterable[Sweep],
    region: Region,
    name: str,
    options: Mapping[str, Any] | None = None,
    *,
    first_index: int = 0,
) -> Detections:
    """Look for the apex in every sweep.

    Args:
        first_index: recording-wide number of the first sweep, for a shard of a recording.

    Raises:
        DetectorError: unknown detector or bad option.
    """
    detector = find_detector(name)
    resolved = resolve_options(detector, options)
    vertices: list[Vertex] = []
    rejected: Counter[str] = Counter()
    frames = 0
    for frames, sweep in enumerate(sweeps, start=1):
        found = _detect(detector, resolved, sweep, region, first_index + frames - 1)
        if isinstance(found, Rejection):
            rejected[found.reason] += 1
        else:
            vertices.append(found)
    return Detections(vertices, frames, dict(sorted(rejected.items())))
