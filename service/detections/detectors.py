"""Names and options of the detectors, in the service's own words.

The workers hold the detectors themselves (``workers/vertices/detectors.py``), and the service may not import
them; a contract test asserts that both sides know the same names, options, limits and defaults.
"""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from service.http.problems import Problem


class DetectorOptions(BaseModel):
    """Numbers that steer a detector; what is not given has its default."""

    model_config = ConfigDict(extra="forbid", strict=True)


class StrictOptions(DetectorOptions):
    """``strict``: exactly one point on the highest ring (Algorithm 1 of the paper)."""

    min_ring_span: int = Field(3, ge=1, le=127)


class TolerantOptions(DetectorOptions):
    """``tolerant``: one to three points close together on the highest ring; their mean (the authors' toolbox)."""

    min_points: int = Field(10, ge=1, le=100_000)
    max_top_points: int = Field(3, ge=1, le=1000)
    max_spread_m: float = Field(0.05, ge=0.0, le=10.0)
    min_points_two_below: int = Field(3, ge=0, le=1000)


class RefinedOptions(DetectorOptions):
    """``refined``: the board's plane and right-angled corner, fitted to every ray that meets or misses it."""

    board_width_m: float = Field(0.0, ge=0.0, le=3.0)
    board_height_m: float = Field(0.0, ge=0.0, le=3.0)
    edge_growth_mrad: float = Field(-1.0, ge=-1.0, le=10.0)
    track: int = Field(1, ge=0, le=1)
    max_sigma_deg: float = Field(0.15, ge=0.005, le=2.0)


# What a person who confirms a vertex is told; a contract test holds these to the workers' own words.
FLAGS: dict[str, str] = {
    "head_above": "something stands above the apex and behind the board, a head perhaps: look whether the vertex is "
    "the board's",
    "second_board": "another object in the region looks nearly as much like the board",
    "occluded": "something stands in front of a part of the board's edges",
    "track_jump": "the vertex lies off the path of the sweeps before and after",
}

DETECTORS: dict[str, type[DetectorOptions]] = {
    "strict": StrictOptions,
    "tolerant": TolerantOptions,
    "refined": RefinedOptions,
}


def resolve_options(detector: str, options: dict[str, Any]) -> dict[str, Any]:
    """All options of a detector: its defaults, overlaid with those given.

    Raises:
        Problem: 422 ``unknown_detector`` naming those there are, or ``invalid_options`` naming the option.
    """
    known = DETECTORS.get(detector)
    if known is None:
        raise Problem(
            422,
            "unknown_detector",
            f"There is no detector {detector!r}.",
            f"The detectors are {', '.join(DETECTORS)}.",
            detectors=list(DETECTORS),
        )
    try:
        return known.model_validate(options).model_dump()
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        name = ".".join(str(step) for step in first["loc"])
        is_unknown = first["type"] == "extra_forbidden"
        raise Problem(
            422,
            "invalid_options",
            f"The detector {detector} has no option {name}."
            if is_unknown
            else f"The option {name} of the detector {detector}: {first['msg']}.",
            f"Its options are {', '.join(known.model_fields)}.",
        ) from None
