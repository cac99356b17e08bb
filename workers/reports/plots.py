"""The plots of a report: what each shows, by the names of columns in the report's document."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

Json = dict[str, Any]
ARROW_SCALE: Final = 20.0
"""Arrows are drawn so many times as long as the residuals are."""


@dataclass(frozen=True)
class Plot:
    """One plot. ``x``, ``y`` (and ``to_x``, ``to_y`` of arrows, ``colour`` of points) are paths into the document.

    ``points``: whose rows the columns are: the pairs, or nobody's that can be chosen. ``mesh``: path of a map that is
    drawn behind. ``says`` describes the plot to who does not see it.
    """

    name: str
    title: str
    x_label: str
    y_label: str
    says: str
    x: str = ""
    y: str = ""
    to_x: str = ""
    to_y: str = ""
    colour: str = ""
    colour_label: str = ""
    mesh: str = ""
    steps: str = ""
    person: str = ""
    points: str = "pairs"
    is_image: bool = False
    is_equal: bool = False
    is_log: bool = False


@dataclass(frozen=True)
class Section:
    """Plots under one heading."""

    name: str
    title: str
    plots: list[Plot]


def sections_of(document: Json) -> list[Section]:
    """All plots of a report, in the order in which they are shown."""
    sections = [Section("residuals", "Residuals", _residuals(document))]
    if document["people"]:
        sections.append(
            Section("people", "By person", [_of_person(*person) for person in enumerate(document["people"])])
        )
    sections.append(Section("elsewhere", "Other recordings", _curves(document)))
    sections += [Section(f"maps-{name}", f"Error maps of {name}", _maps(name)) for name in document["models"]]
    if document["slots"]["loss_px"]:
        sections.append(Section("search", "Convergence of the search", [_SLOTS]))
    return sections


def column(document: Json, path: str) -> Any:
    """What a path such as ``pairs/range_m`` names."""
    value: Any = document
    for step in path.split("/"):
        value = value[int(step)] if isinstance(value, list) else value[step]
    return value


def rows_of(plot: Plot, document: Json) -> list[int]:
    """The number of the pair behind each point that can be chosen, in the order in which the points are drawn."""
    if not plot.points:
        return []
    x = column(document, plot.x) if plot.x else range(len(column(document, plot.y)))
    pairs = range(len(x)) if plot.points == "pairs" else column(document, plot.points)
    return [
        pair for pair, a, b in zip(pairs, x, column(document, plot.y), strict=True) if a is not None and b is not None
    ]


def _residuals(document: Json) -> list[Plot]:
    timed = "seconds" in document["pairs"]
    error: dict[str, Any] = {"y": "pairs/error_px", "y_label": "distance of mark and projection, px"}
    return [
        Plot(
            "arrows",
            f"In the image, arrows {ARROW_SCALE:.0f} times as long",
            "u, px",
            "v, px",
            "One arrow for each pair, from the projected vertex towards the mark.",
            x="pairs/projected_u",
            y="pairs/projected_v",
            to_x="pairs/off_u",
            to_y="pairs/off_v",
            is_image=True,
        ),
        Plot(
            "offsets",
            "Marks about their projections",
            "to the right, px",
            "down, px",
            "The offset of each mark from its projected vertex.",
            x="pairs/off_u",
            y="pairs/off_v",
            is_equal=True,
        ),
        Plot(
            "by_range",
            "By range",
            "range from the LiDAR, m",
            says="The distance of each pair over its range.",
            x="pairs/range_m",
            **error,
        ),
        Plot(
            "by_angle",
            "By angle to the camera's axis",
            "angle to the axis, degrees",
            says="The distance of each pair over its angle to the axis; lines show the RMS of quarters of the pairs.",
            x="pairs/angle_deg",
            steps="rings",
            **error,
        ),
        Plot(
            "over_time",
            "Over time" if timed else "In the order of the pairs",
            "time since the first pair, s" if timed else "number of the pair",
            says="The distance of each pair over time." if timed else "The distance of each pair, in their order.",
            x="pairs/seconds" if timed else "",
            **error,
        ),
    ]


def _of_person(number: int, person: Json) -> Plot:
    at = f"people/{number}"
    return Plot(
        f"person-{number}",
        person["name"],
        "to the right, px",
        "down, px",
        f"The offsets of the marks of {person['name']} from the projected vertices; the cross is the mean.",
        x=f"{at}/off_u",
        y=f"{at}/off_v",
        person=at,
        points=f"{at}/pair",
        is_equal=True,
    )


def _curves(document: Json) -> list[Plot]:
    """The scores of drives over yaw and pitch of the mount."""
    return [
        Plot(
            f"curve-{number}-{curve['offset']}",
            f"{validation['kind']} of {validation['data']}, {curve['offset']}",
            "turn of the mount, degrees",
            _SCORES[validation["kind"]],
            f"The score over {curve['offset']} of the mount. A sharp peak at zero speaks for the result, a flat "
            "curve shows nothing.",
            x=f"elsewhere/{number}/curves/{index}/at",
            y=f"elsewhere/{number}/curves/{index}/score",
            points="",
        )
        for number, validation in enumerate(document["elsewhere"])
        for index, curve in enumerate(validation.get("curves") or [])
        if curve["offset"] in ("yaw", "pitch")
    ]


_SCORES: Final = {"lanes": "share on bright pixels, 1", "edges": "relative gradient, 1"}


def _maps(model: str) -> list[Plot]:
    at = f"models/{model}"
    measured: dict[str, Any] = {"colour": f"{at}/measured_px", "colour_label": "distance, px"}
    predicted: dict[str, Any] = {"colour_label": "stated deviation, px", "points": ""}
    ground: dict[str, Any] = {"x_label": "x of the LiDAR, m", "y_label": "y of the LiDAR, m", "is_equal": True}
    image: dict[str, Any] = {"x_label": "u, px", "y_label": "v, px", "is_image": True}
    return [
        Plot(
            f"ground-measured-{model}",
            f"{model}, ground, measured",
            says="The pairs from above, coloured by the distance of mark and projection.",
            x="pairs/x",
            y="pairs/y",
            **ground,
            **measured,
        ),
        Plot(
            f"ground-predicted-{model}",
            f"{model}, ground, predicted",
            says="The standard deviation that the result states, from above, at the height of the vertices.",
            mesh=f"{at}/ground",
            **ground,
            **predicted,
        ),
        Plot(
            f"image-measured-{model}",
            f"{model}, image, measured",
            says="The marks in the image, coloured by the distance of mark and projection.",
            x="pairs/u",
            y="pairs/v",
            **image,
            **measured,
        ),
        Plot(
            f"image-predicted-{model}",
            f"{model}, image, predicted",
            says="The standard deviation that the result states, over the image, at the median range of the pairs.",
            mesh=f"{at}/image",
            **image,
            **predicted,
        ),
    ]


_SLOTS = Plot(
    "slots",
    "Best loss of each slot",
    "iteration",
    "loss, px",
    "The loss of each slot of the genetic algorithm, by iteration.",
    x="slots/iteration",
    y="slots/loss_px",
    points="",
    is_log=True,
)
