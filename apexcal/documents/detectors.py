"""The detectors of the board's apex as they are offered: their options, reasons and flags."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final, Literal, NamedTuple

from apexcal.documents.errors import DocumentError, chosen

DetectorName = Literal["strict", "tolerant", "refined"]
Quality = Literal["fine", "usable"]
PairingMode = Literal["auto", "nearest", "interpolate"]
Options = Mapping[str, float]


class NumberOption(NamedTuple):
    """A number that steers a detector; a whole one where ``default`` is."""

    default: float
    minimum: float
    maximum: float
    description: str


class DetectorWords(NamedTuple):
    """A detector in words: what it does, its options, and why it finds no vertex in a sweep (name -> sentence)."""

    summary: str
    options: Mapping[str, NumberOption]
    reasons: Mapping[str, str]


MOST_SIGMA_DEG: Final = 0.15
"""Of a walk's corners: one that is known worse tells little beside its better ones."""
MOST_UPPER_SIGMA_DEG: Final = 0.58
"""Of still poses, which are few: a level edge between rings 2 degrees apart (data sheet of the VLP-16) is known by
2 / sqrt(12) degrees.
"""
_UP = (
    "{axis} of the direction of up in the LiDAR's frame; all three 0: as the rig states it, else as the ground "
    "tells. State it if the LiDAR is tilted by more than 35 degrees, or another corner is taken for the top one"
)
_NO_POINTS = "no point of the sweep lies in the region"
# Reasons that every detector has for recordings of still poses.
_STILL_POSES = {
    "nothing_differs": "all points in the region are at the same place in the other sweeps too: the board is outside "
    "of the region, or was not moved",
    "same_pose": "another sweep of the same still pose carries the corner: the mean of those that agree with it",
}

DETECTORS: Final[dict[DetectorName, DetectorWords]] = {
    "strict": DetectorWords(
        "Exactly one point on the highest ring (Algorithm 1 of the paper).",
        {"min_ring_span": NumberOption(3, 1, 127, "highest minus lowest ring that has points in the region")},
        {
            "no_points": _NO_POINTS,
            "ring_span_too_small": "the rings in the region span too few to be a person with a board",
            "top_ring_not_single": "more than one point on the highest ring",
        }
        | _STILL_POSES,
    ),
    "tolerant": DetectorWords(
        "One to three points close together on the highest ring; their mean (the authors' toolbox).",
        {
            "min_points": NumberOption(10, 1, 100_000, "points in the region"),
            "max_top_points": NumberOption(3, 1, 1000, "points on the highest ring"),
            "max_spread_m": NumberOption(0.05, 0.0, 10.0, "largest distance between points on the highest ring"),
            "min_points_two_below": NumberOption(3, 0, 1000, "points two rings below the highest"),
        },
        {
            "no_points": _NO_POINTS,
            "too_few_points": "too few points of the sweep lie in the region",
            "top_ring_too_wide": "too many points on the highest ring",
            "top_points_apart": "the points on the highest ring are too far apart",
            "too_few_points_two_rings_below": "too few points two rings below the highest",
        }
        | _STILL_POSES,
    ),
    "refined": DetectorWords(
        "The board's plane and right-angled corner, fitted to every ray that meets or misses it, and its covariance.",
        {
            "board_width_m": NumberOption(
                0.0, 0.0, 3.0, "one edge of the board in metres; 0: estimated from near sweeps"
            ),
            "board_height_m": NumberOption(0.0, 0.0, 3.0, "the other edge in metres; 0: estimated from near sweeps"),
            "upper_corner": NumberOption(
                0,
                -1,
                1,
                "which corner it is. 0: the top one, of a board with a corner up. Of a board with level edges 1: "
                "the upper left corner, -1: the upper right one, as the LiDAR sees them; state the size with it",
            ),
            "edge_growth_mrad": NumberOption(
                -1.0,
                -1.0,
                10.0,
                "how far outside the board's edges a beam still returns from it, in milliradians (half the width of "
                "the beam, or less); -1: estimated from near sweeps",
            ),
            "up_x": NumberOption(0.0, -1.0, 1.0, _UP.format(axis="x")),
            "up_y": NumberOption(0.0, -1.0, 1.0, _UP.format(axis="y")),
            "up_z": NumberOption(0.0, -1.0, 1.0, _UP.format(axis="z")),
            "track": NumberOption(
                1, 0, 1, "1: the sweeps before and after tell the board's roll and outliers; 0: each for itself"
            ),
            "max_sigma_deg": NumberOption(
                0.0,
                0.0,
                2.0,
                "largest standard deviation of an accepted corner in degrees, azimuth and elevation together; 0: "
                f"{MOST_SIGMA_DEG:g}, or {MOST_UPPER_SIGMA_DEG:g} for an upper corner in still poses",
            ),
        },
        {
            "no_points": _NO_POINTS,
            "too_few_rings": "fewer than two rings meet anything in the region that could be the board: walk closer",
            "outside_the_region": "what looks like the board stands outside of the region: widen it",
            "size_not_stated": "the board's size was not stated, and fewer than four boards are near enough to "
            "tell it. State it (`--board`): then two rings on a board are enough",
            "overtopped": "something stands above what looks like the board and in front of its plane. It is a body, "
            "and the board meets too few rings: walk closer, or hold the board higher",
            "not_a_board": "nothing in the region is flat with a right-angled corner at the top: hold the board with "
            "a corner up, lean it by less than 35 degrees, and turn it by less than 60 degrees from the sensor",
            "upright_object": "an upright rectangle explains the rays as well as the board: a sign, a door, the end "
            "of a wall, or a lowered board. Hold it with a corner up; if its edges are to be level, state the "
            "corner to find (`--corner`). If this is a single pose or shorter than six seconds, record a longer walk "
            "or several poses, or come closer",
            "like_a_person": "on the few rings that meet it, what looks like the board is no wider than a person, "
            "and the sweeps before and after show no wider board there: walk closer",
            "never_shown": "the near sweeps of this recording do not show a board, so this could be a person. State "
            "the board's size: then four rings that meet it are enough. With fewer rings, walk closer, and lower the "
            "board as little as possible",
            "too_uncertain": "the board's corner is too uncertain: walk closer, or state the board's size",
            "not_still": "the board moves here: hold it still for two seconds in each pose",
            "off_the_track": "the corner lies far off the path of the sweeps before and after, so it is no board",
        }
        | _STILL_POSES,
    ),
}

# Where the board's size was stated, as it is wherever an upper corner is looked for.
_SIZE_STATED: Final[Mapping[str, str]] = {
    "never_shown": "the near sweeps of this recording do not show a board, so this could be a person: walk closer, "
    "and lower the board as little as possible",
    "too_uncertain": "the board's corner is too uncertain: walk closer",
}
_UPPER_CORNER: Final[Mapping[str, str]] = {
    **_SIZE_STATED,
    "too_few_rings": "fewer than four rings meet anything in the region that could be the board: walk closer",
    "not_a_board": "nothing in the region is flat, has the stated size, and has level and upright edges, as a board "
    "does that leans by less than 35 degrees and is turned by less than 60 degrees from the sensor",
    "upright_object": "an upright rectangle of another size explains the rays as well as the board, or nothing shows "
    "that somebody carries it: a sign, a door, the end of a wall. Measure the board's edges; if this is a single "
    "pose or shorter than six seconds, record several poses or a longer walk, or come closer",
    "too_uncertain": "the board's corner is too uncertain: walk closer, or "
    "roll the board by 5 to 10 degrees: rings that cross its upper edge tell how high it is",
}

# What a person who confirms a vertex is told.
FLAGS: Final[Mapping[str, str]] = {
    "head_above": "something stands above the corner and behind the board, a head perhaps: check that the corner is "
    "the board's",
    "second_board": "another object in the region looks nearly as much like the board",
    "occluded": "something stands in front of a part of the board's edges",
    "track_jump": "the corner lies off the path of the sweeps before and after",
}


def parse_detector(name: str) -> DetectorName:
    """The detector of that name. Raises DocumentError ``unknown_detector`` that lists the names there are."""
    return chosen(name, DETECTORS, "detector")


def sentences_of(
    detector: str, reasons: Iterable[str], examples: Mapping[str, str], options: Mapping[str, Any]
) -> dict[str, str]:
    """Return each of a detector's reasons in words, with what one of its sweeps shows. No option is advised twice."""
    sentences = dict(next((words.reasons for name, words in DETECTORS.items() if name == detector), {}))
    is_sized = options.get("board_width_m") and options.get("board_height_m")
    sentences |= _UPPER_CORNER if options.get("upper_corner") else _SIZE_STATED if is_sized else {}
    return {
        reason: sentences[reason] + (f" ({examples[reason]})" if reason in examples else "")
        for reason in reasons
        if reason in sentences
    }


def resolve_options(detector: str, overrides: Mapping[str, Any] | None = None) -> dict[str, float]:
    """All options of a detector: its defaults, overlaid with those given.

    Raises:
        DocumentError: ``unknown_detector``; ``invalid_options`` that names the option.
    """
    options = DETECTORS[parse_detector(detector)].options
    resolved: dict[str, float] = {name: option.default for name, option in options.items()}
    for name, value in (overrides or {}).items():
        if name not in options:
            raise DocumentError(
                "invalid_options",
                f"The detector {detector} has no option {name}.",
                f"Its options are {', '.join(options)}.",
            )
        option = options[name]
        whole = isinstance(option.default, int)
        is_number = isinstance(value, int if whole else int | float) and not isinstance(value, bool)
        if not is_number or not option.minimum <= value <= option.maximum:
            raise DocumentError(
                "invalid_options",
                f"The option {name} of the detector {detector} cannot be {value!r:.60}.",
                f"Give {'an integer' if whole else 'a number'} from {option.minimum} to {option.maximum}.",
            )
        resolved[name] = value if whole else float(value)
    if resolved.get("upper_corner") and not (resolved["board_width_m"] and resolved["board_height_m"]):
        raise DocumentError(
            "invalid_options",
            "A board with level edges is told from a sign by its size, which was not stated.",
            "State both edges: board_width_m and board_height_m (--board), in metres.",
        )
    return resolved
