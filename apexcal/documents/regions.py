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
import sys
from collections.abc import Iterator, Mapping, Sequence
from itertools import count
from typing import Any, Final, cast

from apexcal.documents.errors import DocumentError

# The position of each name is its number in the compiled program.
QUANTITIES: Final = ("x", "y", "z", "range", "azimuth_deg", "elevation_deg")
OPERATORS: Final = ("<", "<=", ">", ">=")
MAX_DEPTH: Final = 16
MAX_NODES: Final = 256
MAX_CORNERS: Final = 64
MAX_METRES: Final = 1e6
_SHORTEST: Final = 1e-3  # of a direction; shorter ones are zeros that were rounded

Document = dict[str, Any]


class RegionError(DocumentError):
    """A region document that cannot be used; its message names the bad node, for example ``$.and[1].op``.

    Codes: ``region_invalid``, ``region_too_large``.
    """


def check_region(document: object) -> Document:
    """The document in its canonical form (members that are null left out).

    Raises:
        RegionError: naming the path of the first bad node, or that the tree is too deep or too large.
    """
    if isinstance(document, Mapping) and "level" in document:
        tree = cast("Mapping[Any, object]", document)
        _only(tree, ("level", "up"), "$")
        return {"level": _node(tree["level"], "$.level", 2, count(1)), "up": _up(tree.get("up"))}
    return _node(document, "$", 1, count())


def _up(document: object) -> list[float]:
    hint = 'Write "up": [x, y, z], the direction of up in the LiDAR\'s frame.'
    numbers = _list(document)
    if len(numbers) != 3:
        raise _fail("$.up", "it is no list of three numbers", hint)
    up = [_number(value, f"$.up[{i}]", MAX_METRES) for i, value in enumerate(numbers)]
    if math.hypot(*up) < _SHORTEST:
        raise _fail("$.up", "it has no direction", hint)
    return up


def _fail(path: str, what: str, hint: str, code: str = "region_invalid") -> RegionError:
    return RegionError(code, f"region node {path}: {what}.", hint)


def _node(node: object, path: str, depth: int, counter: Iterator[int]) -> Document:
    if depth > MAX_DEPTH:
        what = f"the tree is deeper than {MAX_DEPTH} levels"
        raise _fail(path, what, "Merge nested and / or nodes.", "region_too_large")
    if next(counter) >= MAX_NODES:
        what = f"the tree is larger than {MAX_NODES} nodes"
        raise _fail(path, what, "Merge inequalities, or use a box or a polygon.", "region_too_large")
    if not isinstance(node, Mapping):
        raise _fail(path, "it is no object", 'Write {"and": [...]}, a box, a polygon or an inequality.')
    tree = cast("Mapping[Any, object]", node)
    for name in ("and", "or"):
        if name in tree:
            return {name: _children(tree, name, path, depth, counter)}
    if "not" in tree:
        _only(tree, ("not",), path)
        return {"not": _node(tree["not"], f"{path}.not", depth + 1, counter)}
    if "box" in tree:
        _only(tree, ("box",), path)
        return {"box": _box(tree["box"], f"{path}.box")}
    if "polygon" in tree:
        return _polygon(tree, path)
    if "level" in tree:
        hint = 'Write {"level": the whole tree, "up": [x, y, z]}.'
        raise _fail(path, "only a whole region may be in level axes", hint)
    return _inequality(tree, path)


def _children(node: Mapping[Any, object], name: str, path: str, depth: int, counter: Iterator[int]) -> list[Document]:
    _only(node, (name,), path)
    children = _list(node[name])
    if not children:
        raise _fail(f"{path}.{name}", "it is no list of at least one node", "Put boxes or inequalities in it.")
    return [_node(child, f"{path}.{name}[{i}]", depth + 1, counter) for i, child in enumerate(children)]


def _inequality(node: Mapping[Any, object], path: str) -> Document:
    _only(node, ("quantity", "divided_by", "op", "value"), path)
    for name in ("quantity", "op", "value"):
        if name not in node:
            raise _fail(path, f"it lacks {name!r}", 'Example: {"quantity": "x", "op": ">", "value": 0}.')
    leaf: Document = {"quantity": _choice(node["quantity"], QUANTITIES, f"{path}.quantity")}
    if node.get("divided_by") is not None:
        leaf["divided_by"] = _choice(node["divided_by"], QUANTITIES, f"{path}.divided_by")
    leaf["op"] = _choice(node["op"], OPERATORS, f"{path}.op")
    leaf["value"] = _number(node["value"], f"{path}.value")
    return leaf


def _box(box: object, path: str) -> Document:
    hint = 'Write {"min": [x, y, z], "max": [x, y, z]}, perhaps with "yaw_deg".'
    if not isinstance(box, Mapping):
        raise _fail(path, "it is no object", hint)
    members = cast("Mapping[Any, object]", box)
    _only(members, ("min", "max", "yaw_deg"), path)
    corners: dict[str, list[float]] = {}
    for name in ("min", "max"):
        numbers = _list(members.get(name))
        if len(numbers) != 3:
            raise _fail(f"{path}.{name}", "it is no list of three numbers", hint)
        corners[name] = [_number(value, f"{path}.{name}[{i}]", MAX_METRES) for i, value in enumerate(numbers)]
    for axis, low, high in zip("xyz", corners["min"], corners["max"], strict=True):
        if low >= high:
            raise _fail(path, f"min is not below max in {axis}", "Exchange them.")
    if members.get("yaw_deg") is None:
        return {**corners}
    return {**corners, "yaw_deg": _number(members["yaw_deg"], f"{path}.yaw_deg", 360.0)}


def _polygon(node: Mapping[Any, object], path: str) -> Document:
    _only(node, ("polygon", "z"), path)
    corners = _list(node["polygon"])
    if not 3 <= len(corners) <= MAX_CORNERS:
        raise _fail(
            f"{path}.polygon", f"it is no list of 3 to {MAX_CORNERS} corners", "Write [[x, y], ...] in metres."
        )
    shape: Document = {"polygon": [_pair(xy, f"{path}.polygon[{i}]") for i, xy in enumerate(corners)]}
    if node.get("z") is not None:
        low, high = _pair(node["z"], f"{path}.z")
        if low >= high:
            raise _fail(f"{path}.z", "low is not below high", "Write [low, high] in metres.")
        shape["z"] = [low, high]
    return shape


def _pair(value: object, path: str) -> list[float]:
    numbers = _list(value)
    if len(numbers) != 2:
        raise _fail(path, "it is no list of two numbers", "Give two numbers in metres.")
    return [_number(number, f"{path}[{i}]", MAX_METRES) for i, number in enumerate(numbers)]


def _only(node: Mapping[Any, object], names: tuple[str, ...], path: str) -> None:
    unknown = sorted(str(key)[:60] for key in node if key not in names)
    if unknown:
        raise _fail(path, f"it has {unknown[0]!r} beside", f"Possible here: {', '.join(names)}.")


def _list(value: object) -> Sequence[object]:
    return cast("Sequence[object]", value) if isinstance(value, list | tuple) else ()


def _choice(name: object, choices: tuple[str, ...], path: str) -> str:
    if not isinstance(name, str) or name not in choices:
        raise _fail(path, f"{str(name)[:60]!r} is not known", f"One of: {', '.join(choices)}.")
    return name


def _number(value: object, path: str, largest: float = sys.float_info.max) -> float:
    # Comparing is exact also for integers that are too large for a float, and false for not-a-number.
    if isinstance(value, bool) or not isinstance(value, int | float) or not -largest <= value <= largest:
        within = f" from {-largest:g} to {largest:g}" if largest < sys.float_info.max else ""
        raise _fail(path, f"it is no finite number{within}", "Give metres, degrees or a ratio.")
    return value
