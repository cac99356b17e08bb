"""Regions of interest: which JSON documents are one. Text is never evaluated.

A region is a plain list: points lie inside where ``all`` parts hold and ``none`` of the others. Parts:

- ``{"quantity": "z", "divided_by": "x", "op": ">", "value": 0.2}``, an inequality (here the toolbox's z / x > 0.2);
- ``{"box": {"min": [x, y, z], "max": [x, y, z], "yaw_deg": 30}}``, turned about its own upright axis,
  counter-clockwise seen from above; without ``yaw_deg`` its sides are parallel to the axes;
- ``{"polygon": [[x, y], ...], "z": [low, high]}``, 3 to 64 corners seen from above; where it crosses itself the
  even-odd rule says what is inside; without ``z`` it reaches from the ground to the sky.

Quantities are x, y, z and range in metres, azimuth_deg and elevation_deg, all in the LiDAR's frame.

With ``up``, the direction of up in the frame of a tilted LiDAR, the parts are in level axes. Their z is that
direction. Their x is the horizontal direction nearest to the LiDAR's x, or to its y if up is within 26 degrees of its
x. Their origin is the LiDAR's.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Final, Literal, NotRequired, get_args

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Discriminator,
    Field,
    PlainSerializer,
    Tag,
    TypeAdapter,
    ValidationError,
    WrapValidator,
    with_config,
)
from typing_extensions import TypeAliasType, TypedDict

from apexcal.documents.base import Stored
from apexcal.documents.errors import DocumentError

Quantity = Literal["x", "y", "z", "range", "azimuth_deg", "elevation_deg"]
Operator = Literal["<", "<=", ">", ">="]
# The position of each name is its number in the kernel that evaluates regions.
QUANTITIES: Final = get_args(Quantity)
OPERATORS: Final = get_args(Operator)
MAX_PARTS: Final = 256
MAX_CORNERS: Final = 64
MAX_METRES: Final = 1e6
_SHORTEST: Final = 1e-3  # of a direction; shorter ones are zeros that were rounded
_HINT: Final = (
    'Write {"all": [parts]}, with "none": [parts] for what is cut out. A part is '
    '{"quantity": "x", "op": ">", "value": 0}, {"box": {"min": [x, y, z], "max": [x, y, z]}} or '
    '{"polygon": [[x, y], ...]}.'
)

Document = dict[str, Any]
_Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
_Metres = Annotated[_Number, Field(ge=-MAX_METRES, le=MAX_METRES)]
_Two = Annotated[list[_Metres], Field(min_length=2, max_length=2)]
_Three = Annotated[list[_Metres], Field(min_length=3, max_length=3)]


class RegionError(DocumentError):
    """A region document that cannot be used; its message names the bad part, for example ``$.all[1].op``."""


def _rises(shape: BoxShape) -> BoxShape:
    for axis, low, high in zip("xyz", shape["min"], shape["max"], strict=True):
        if low >= high:
            raise ValueError(f"min is not below max in {axis}")
    return shape


def _ascends(heights: list[float]) -> list[float]:
    if heights[0] >= heights[1]:
        raise ValueError("low is not below high")
    return heights


def _points(up: list[float]) -> list[float]:
    if math.hypot(*up) < _SHORTEST:
        raise ValueError("it has no direction")
    return up


def _without_nulls(node: Any) -> Any:
    return {name: value for name, value in node.items() if value is not None} if isinstance(node, Mapping) else node


@with_config(extra="forbid")
class Inequality(TypedDict):
    """``quantity``, or its quotient by another one, compared with ``value``; metres, degrees or a ratio."""

    quantity: Quantity
    divided_by: NotRequired[Quantity]
    op: Operator
    value: _Number


@with_config(extra="forbid")
class BoxShape(TypedDict):
    """Two corners in metres; ``yaw_deg`` turns the box about its own upright axis, counter-clockwise from above."""

    min: Annotated[_Three, Field(examples=[[9, -1, -2]])]
    max: Annotated[_Three, Field(examples=[[10, 1, 1]])]
    yaw_deg: NotRequired[Annotated[_Number, Field(ge=-360, le=360)]]


@with_config(extra="forbid")
class Box(TypedDict):
    """The points in a box."""

    box: Annotated[BoxShape, BeforeValidator(_without_nulls), AfterValidator(_rises)]


@with_config(extra="forbid")
class Polygon(TypedDict):
    """The points over a polygon seen from above, between two heights where ``z`` is given; metres."""

    polygon: Annotated[list[_Two], Field(min_length=3, max_length=MAX_CORNERS)]
    z: NotRequired[Annotated[_Two, AfterValidator(_ascends)]]


def _kind(part: Any) -> str | None:
    names = ("box", "polygon") if isinstance(part, Mapping) else ()
    return next((f"<{name}>" for name in names if name in part), "<inequality>" if names else None)


RegionPart = TypeAliasType(
    "RegionPart",
    Annotated[
        Annotated[Box, Tag("<box>")]
        | Annotated[Polygon, Tag("<polygon>")]
        | Annotated[Inequality, Tag("<inequality>")],
        Discriminator(_kind, "no_object", "it is no object"),
        BeforeValidator(_without_nulls),
    ],
)
_Parts = Annotated[list[RegionPart], Field(min_length=1, max_length=MAX_PARTS)]


@with_config(extra="forbid")
class RegionParts(TypedDict):
    """The points where all parts of ``all`` hold and none of ``none``; with ``up`` the parts are in level axes."""

    all: _Parts
    none: NotRequired[_Parts]
    up: NotRequired[Annotated[_Three, AfterValidator(_points)]]


_Region = Annotated[RegionParts, BeforeValidator(_without_nulls)]
_REGION: Final = TypeAdapter[Any](_Region)


def check_region(document: object) -> Document:
    """The document in its canonical form (members that are null left out).

    Raises:
        RegionError: naming the path of the first bad part.
    """
    try:
        return _REGION.validate_python(document)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
    # Tags of the union are no members of the document.
    steps = [step for step in first["loc"] if not str(step).startswith("<")]
    if first["type"] in ("missing", "extra_forbidden"):
        what = f"it {'lacks' if first['type'] == 'missing' else 'has beside'} {str(steps.pop())[:60]!r}"
    else:
        what = first["msg"].removeprefix("Value error, ")
    path = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in steps)
    raise RegionError("region_invalid", f"region ${path}: {what}.", _HINT)


_SAYS = Field(
    description="The points where all parts of `all` hold and none of `none`: inequalities, boxes and polygons in "
    f"the LiDAR's frame, at most {MAX_PARTS} each. With `up`, the direction of up in the frame of a tilted LiDAR, "
    "the parts are in level axes.",
    examples=[
        {
            "all": [
                {"polygon": [[2, -3], [30, -6], [30, 6], [2, 3]], "z": [-1.6, 0.8]},
                {"quantity": "range", "op": "<", "value": 28},
                {"quantity": "z", "divided_by": "x", "op": ">", "value": -0.2},
            ],
            "none": [{"box": {"min": [9, -1, -2], "max": [10, 1, 1], "yaw_deg": 20}}],
        }
    ],
)


Region = Annotated[
    _Region,
    WrapValidator(lambda document, _: check_region(document)),
    PlainSerializer(lambda region: region),
    _SAYS,
]
"""A region that somebody sends, in its canonical form."""
KeptRegion = Annotated[Stored[_Region], _SAYS]
