"""Regions as fields of requests and answers, and what the API's description says of them."""

from __future__ import annotations

from typing import Annotated, Any, Literal, NotRequired

from pydantic import Field, PlainSerializer, WrapValidator
from typing_extensions import TypeAliasType, TypedDict

from apexcal.documents.base import Stored
from apexcal.documents.regions import MAX_CORNERS, MAX_DEPTH, MAX_NODES, check_region

Quantity = Literal["x", "y", "z", "range", "azimuth_deg", "elevation_deg"]
Operator = Literal["<", "<=", ">", ">="]
_Two = Annotated[list[float], Field(min_length=2, max_length=2)]
_Three = Annotated[list[float], Field(min_length=3, max_length=3)]


class Inequality(TypedDict):
    """``quantity``, or its quotient by another one, compared with ``value``; metres, degrees or a ratio."""

    quantity: Quantity
    divided_by: NotRequired[Quantity]
    op: Operator
    value: float


class BoxShape(TypedDict):
    """Two corners in metres; ``yaw_deg`` turns the box about its own upright axis, counter-clockwise from above."""

    min: Annotated[_Three, Field(examples=[[9, -1, -2]])]
    max: Annotated[_Three, Field(examples=[[10, 1, 1]])]
    yaw_deg: NotRequired[float]


class Box(TypedDict):
    """The points in a box."""

    box: BoxShape


class Polygon(TypedDict):
    """The points over a polygon seen from above, between two heights where ``z`` is given; metres."""

    polygon: Annotated[list[_Two], Field(min_length=3, max_length=MAX_CORNERS)]
    z: NotRequired[_Two]


# pyright follows no alias to classes that are made by a call.
And = TypedDict("And", {"and": "list[RegionNode]"})  # pyright: ignore[reportInvalidTypeForm]
Or = TypedDict("Or", {"or": "list[RegionNode]"})  # pyright: ignore[reportInvalidTypeForm]
Not = TypedDict("Not", {"not": "RegionNode"})  # pyright: ignore[reportInvalidTypeForm]
RegionNode = TypeAliasType("RegionNode", And | Or | Not | Box | Polygon | Inequality)


class Level(TypedDict):
    """A whole tree in level axes: their z is ``up``, their x the horizontal direction nearest to the LiDAR's x."""

    level: RegionNode
    up: _Three


_SAYS = Field(
    description=f"A tree of and, or and not over inequalities, boxes and polygons in the LiDAR's frame; at most "
    f"{MAX_DEPTH} levels and {MAX_NODES} nodes. For a tilted LiDAR the whole tree may be in level axes: "
    '{"level": tree, "up": [x, y, z]}.',
    examples=[
        {
            "and": [
                {"polygon": [[2, -3], [30, -6], [30, 6], [2, 3]], "z": [-1.6, 0.8]},
                {"quantity": "range", "op": "<", "value": 28},
                {"quantity": "z", "divided_by": "x", "op": ">", "value": -0.2},
                {"not": {"box": {"min": [9, -1, -2], "max": [10, 1, 1], "yaw_deg": 20}}},
            ]
        }
    ],
)


def _checked(document: Any, _: Any) -> Any:
    return check_region(document)


Region = Annotated[RegionNode | Level, WrapValidator(_checked), PlainSerializer(lambda region: region), _SAYS]
"""A region that somebody sends, in its canonical form."""
KeptRegion = Annotated[Stored[RegionNode | Level], _SAYS]
