"""The language of regions: which JSON documents are one, checked node by node. Text is never evaluated.

Branches: ``{"and": [nodes]}``, ``{"or": [nodes]}``, ``{"not": node}``. Leaves:

- ``{"quantity": "z", "divided_by": "x", "op": ">", "value": 0.2}``, an inequality (here the toolbox's z / x > 0.2);
- ``{"box": {"min": [x, y, z], "max": [x, y, z], "yaw_deg": 30}}``, turned about its own upright axis,
  counter-clockwise seen from above; without ``yaw_deg`` its sides are parallel to the axes;
- ``{"polygon": [[x, y], ...], "z": [low, high]}``, 3 to 64 corners seen from above; where it crosses itself the
  even-odd rule says what is inside; without ``z`` it reaches from the ground to the sky.

Quantities are x, y, z and range in metres, azimuth_deg and elevation_deg, all in the LiDAR's frame.

For a tilted LiDAR the whole tree may be in level axes: ``{"level": node, "up": [x, y, z]}``, with the direction of up
in the LiDAR's frame. Their z is that direction. Their x is the horizontal direction nearest to the LiDAR's x, or to
its y if up is within 26 degrees of its x. Their origin is the LiDAR's.
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
# The position of each name is its number in the compiled program.
QUANTITIES: Final = get_args(Quantity)
OPERATORS: Final = get_args(Operator)
MAX_DEPTH: Final = 16
MAX_NODES: Final = 256
MAX_CORNERS: Final = 64
MAX_METRES: Final = 1e6
_SHORTEST: Final = 1e-3  # of a direction; shorter ones are zeros that were rounded
_HINT: Final = (
    'Write {"and": [nodes]}, {"or": [nodes]}, {"not": node}, {"box": {"min": [x, y, z], "max": [x, y, z]}}, '
    '{"polygon": [[x, y], ...]} or {"quantity": "x", "op": ">", "value": 0}; a whole tree in level axes as '
    '{"level": tree, "up": [x, y, z]}.'
)

_BRANCHES: Final = ("and", "or", "not", "level")

Document = dict[str, Any]
_Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
_Metres = Annotated[_Number, Field(ge=-MAX_METRES, le=MAX_METRES)]
_Two = Annotated[list[_Metres], Field(min_length=2, max_length=2)]
_Three = Annotated[list[_Metres], Field(min_length=3, max_length=3)]


class RegionError(DocumentError):
    """A region document that cannot be used; its message names the bad node, for example ``$.and[1].op``.

    Codes: ``region_invalid``, ``region_too_large``.
    """


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


# pyright follows no alias to classes that are made by a call.
_some = Annotated["list[RegionNode]", Field(min_length=1)]
And = with_config(extra="forbid")(TypedDict("And", {"and": _some}))  # pyright: ignore[reportInvalidTypeForm]
Or = with_config(extra="forbid")(TypedDict("Or", {"or": _some}))  # pyright: ignore[reportInvalidTypeForm]
Not = with_config(extra="forbid")(TypedDict("Not", {"not": "RegionNode"}))  # pyright: ignore[reportInvalidTypeForm]


def _kind(node: Any) -> str | None:
    names = ("and", "or", "not", "box", "polygon") if isinstance(node, Mapping) else ()
    return next((f"<{name}>" for name in names if name in node), "<inequality>" if names else None)


RegionNode = TypeAliasType(
    "RegionNode",
    Annotated[
        Annotated[And, Tag("<and>")]
        | Annotated[Or, Tag("<or>")]
        | Annotated[Not, Tag("<not>")]
        | Annotated[Box, Tag("<box>")]
        | Annotated[Polygon, Tag("<polygon>")]
        | Annotated[Inequality, Tag("<inequality>")],
        Discriminator(_kind, "no_object", "it is no object"),
        BeforeValidator(_without_nulls),
    ],
)


@with_config(extra="forbid")
class Level(TypedDict):
    """A whole tree in level axes: their z is ``up``, their x the horizontal direction nearest to the LiDAR's x."""

    level: RegionNode
    up: Annotated[_Three, AfterValidator(_points)]


_Tree = Annotated[
    Annotated[RegionNode, Tag("<tree>")] | Annotated[Level, Tag("<level>")],
    Discriminator(lambda region: "<level>" if isinstance(region, Mapping) and "level" in region else "<tree>"),
]
_TREE: Final = TypeAdapter[Any](_Tree)


def check_region(document: object) -> Document:
    """The document in its canonical form (members that are null left out).

    Raises:
        RegionError: naming the path of the first bad node, or that the tree is too deep or too large.
    """
    _check_extent(document)
    try:
        return _TREE.validate_python(document)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
    # Tags of the union are no members of the document.
    steps = [step for step in first["loc"] if not str(step).startswith("<")]
    if first["type"] in ("missing", "extra_forbidden"):
        what = f"it {'lacks' if first['type'] == 'missing' else 'has beside'} {str(steps.pop())[:60]!r}"
    else:
        what = first["msg"].removeprefix("Value error, ")
    path = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in steps)
    raise RegionError("region_invalid", f"region node ${path}: {what}.", _HINT)


def _check_extent(document: object) -> None:
    """Raises RegionError before anything is called once for each level of the document."""
    level, count = [document], 0
    for _ in range(MAX_DEPTH):
        count += len(level)
        if count > MAX_NODES:
            break
        branches = [node.get(name) for node in level if isinstance(node, Mapping) for name in _BRANCHES]
        level = [node for branch in branches for node in (branch if isinstance(branch, list) else [branch])]
        level = [node for node in level if isinstance(node, Mapping)]
        if not level:
            return
    what = f"larger than {MAX_NODES} nodes" if count > MAX_NODES else f"deeper than {MAX_DEPTH} levels"
    raise RegionError("region_too_large", f"region node $: the tree is {what}.", "Merge nested and / or nodes.")


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


Region = Annotated[
    _Tree,
    WrapValidator(lambda document, _: check_region(document)),
    PlainSerializer(lambda region: region),
    _SAYS,
]
"""A region that somebody sends, in its canonical form."""
KeptRegion = Annotated[Stored[_Tree], _SAYS]
