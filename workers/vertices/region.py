"""Region of interest: a JSON tree of inequalities, compiled to a flat program that one kernel evaluates.

Text that users supply is never evaluated: the tree is checked node by node and turned into numbers.
A leaf says ``quantity [/ divided_by] op value``; the paper's toolbox filter ``z / x > 0.2`` reads
``{"quantity": "z", "divided_by": "x", "op": ">", "value": 0.2}``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, cast

import numba as nb
import numpy as np
from numpy.typing import NDArray

from workers.geometry.errors import InputError

# The position of each name is its number in the compiled program and in _quantity below.
QUANTITIES = ("x", "y", "z", "range", "azimuth_deg", "elevation_deg")
OPERATORS = ("<", "<=", ">", ">=")
MAX_DEPTH = 16
MAX_NODES = 256
_ACCEPT = -1
_REJECT = -2
_LEAF_KEYS = frozenset({"quantity", "divided_by", "op", "value"})


class RegionError(InputError):
    """A region document that cannot be used; its message names the bad node, for example ``$.and[1].op``.

    Codes: ``region_invalid``, ``region_too_large``.
    """


@dataclass(slots=True)
class _Program:
    """Leaves in evaluation order; each names the next leaf for true and for false, or accept / reject."""

    quantity: list[int] = field(default_factory=list[int])
    divisor: list[int] = field(default_factory=list[int])
    operator: list[int] = field(default_factory=list[int])
    value: list[float] = field(default_factory=list[float])
    if_true: list[int] = field(default_factory=list[int])
    if_false: list[int] = field(default_factory=list[int])


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """A checked region of interest in the LiDAR frame (x forward, y left, z up; metres, degrees).

    Azimuth is atan2(y, x), elevation atan2(z, hypot(x, y)), range the Euclidean distance. A quotient by
    zero follows IEEE 754 (infinite or not a number), and a comparison with not-a-number is false.
    """

    document: Mapping[str, Any]
    _codes: NDArray[np.int32]
    _values: NDArray[np.float64]

    @classmethod
    def from_document(cls, document: object) -> Region:
        """Check and compile a region document.

        Raises:
            RegionError: naming the path of the first bad node, or that the tree is too deep or too large.
        """
        _check(document, "$", 1, 0)
        tree = cast("Mapping[str, Any]", document)
        program = _Program()
        _compile(tree, _ACCEPT, _REJECT, program)
        codes = np.array(
            [program.quantity, program.divisor, program.operator, program.if_true, program.if_false], np.int32
        )
        return cls(tree, np.ascontiguousarray(codes.T), np.array(program.value, np.float64))

    def mask(self, xyz: NDArray[np.floating[Any]]) -> NDArray[np.bool_]:
        """Which points lie inside.

        Args:
            xyz: (N, 3), metres, LiDAR frame.

        Returns:
            (N,) bool; points with a coordinate that is not finite are never inside.
        """
        if xyz.ndim != 2 or xyz.shape[1] != 3:
            raise ValueError(f"xyz must have shape (N, 3), got {xyz.shape}")
        return _mask(xyz, self._codes, self._values)


def _fail(path: str, what: str, hint: str) -> RegionError:
    return RegionError("region_invalid", f"region node {path}: {what}", hint)


def _check(node: object, path: str, depth: int, count: int) -> int:
    """Validate one node and those below; returns the number of nodes seen so far."""
    if depth > MAX_DEPTH or count >= MAX_NODES:
        limit = f"deeper than {MAX_DEPTH} levels" if depth > MAX_DEPTH else f"larger than {MAX_NODES} nodes"
        raise RegionError(
            "region_too_large", f"region node {path}: the tree is {limit}", "Merge nested and / or nodes."
        )
    if not isinstance(node, Mapping):
        raise _fail(path, f"expected an object, got {type(node).__name__}", 'Write {"and": [...]} or a leaf.')
    tree = cast("Mapping[str, object]", node)
    keys = {str(key) for key in tree}
    if keys & {"and", "or"}:
        return _check_branch(tree, keys, path, depth, count + 1)
    _check_leaf(tree, keys, path)
    return count + 1


def _check_branch(node: Mapping[str, object], keys: set[str], path: str, depth: int, count: int) -> int:
    if len(keys) != 1:
        raise _fail(path, f"has the keys {sorted(keys)}", 'A branch has exactly one key, either "and" or "or".')
    name = keys.pop()
    children = node[name]
    if not isinstance(children, Sequence) or isinstance(children, str) or not children:
        raise _fail(f"{path}.{name}", "expected a list of at least one node", "Put the inequalities in it.")
    for index, child in enumerate(cast("Sequence[object]", children)):
        count = _check(child, f"{path}.{name}[{index}]", depth + 1, count)
    return count


def _check_leaf(node: Mapping[str, object], keys: set[str], path: str) -> None:
    if unknown := keys - _LEAF_KEYS:
        raise _fail(path, f"unknown key {min(unknown)!r}", f"A leaf has {', '.join(sorted(_LEAF_KEYS))}.")
    if missing := {"quantity", "op", "value"} - keys:
        raise _fail(path, f"lacks {min(missing)!r}", 'Example: {"quantity": "x", "op": ">", "value": 0}.')
    _check_choice(node["quantity"], QUANTITIES, f"{path}.quantity")
    if "divided_by" in keys:
        _check_choice(node["divided_by"], QUANTITIES, f"{path}.divided_by")
    _check_choice(node["op"], OPERATORS, f"{path}.op")
    value = node["value"]
    if isinstance(value, bool) or not isinstance(value, int | float) or not _finite(value):
        raise _fail(f"{path}.value", f"{value!r} is no finite number", "Give metres, degrees or a ratio.")


def _finite(value: float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer of more than 308 digits
        return False


def _check_choice(name: object, choices: tuple[str, ...], path: str) -> None:
    if not isinstance(name, str) or name not in choices:
        raise _fail(path, f"{str(name)[:60]!r} is not known", f"One of: {', '.join(choices)}.")


def _leaves(node: Mapping[str, Any]) -> int:
    children = node.get("and") or node.get("or")
    return sum(_leaves(child) for child in children) if children else 1


def _compile(node: Mapping[str, Any], if_true: int, if_false: int, program: _Program) -> None:
    """Append the node's leaves; jump targets make and / or short-circuit without a stack."""
    children: Sequence[Mapping[str, Any]] | None = node.get("and") or node.get("or")
    if children is None:
        program.quantity.append(QUANTITIES.index(node["quantity"]))
        divisor = node.get("divided_by")
        program.divisor.append(-1 if divisor is None else QUANTITIES.index(divisor))
        program.operator.append(OPERATORS.index(node["op"]))
        program.value.append(float(node["value"]))
        program.if_true.append(if_true)
        program.if_false.append(if_false)
        return
    conjunction = "and" in node
    for index, child in enumerate(children):
        following = len(program.value) + _leaves(child)
        last = index == len(children) - 1
        go_on = (if_true if conjunction else if_false) if last else following
        if conjunction:
            _compile(child, go_on, if_false, program)
        else:
            _compile(child, if_true, go_on, program)


@nb.njit(nogil=True, cache=True, error_model="numpy", inline="always")
def _quantity(code: int, x: float, y: float, z: float) -> float:
    if code == 0:
        return x
    if code == 1:
        return y
    if code == 2:
        return z
    if code == 3:
        return math.sqrt(x * x + y * y + z * z)
    if code == 4:
        return math.degrees(math.atan2(y, x))
    return math.degrees(math.atan2(z, math.sqrt(x * x + y * y)))


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _mask(xyz: NDArray[np.floating[Any]], codes: NDArray[np.int32], values: NDArray[np.float64]) -> NDArray[np.bool_]:
    inside = np.zeros(xyz.shape[0], np.bool_)
    for i in range(xyz.shape[0]):
        x, y, z = np.float64(xyz[i, 0]), np.float64(xyz[i, 1]), np.float64(xyz[i, 2])
        if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
            continue
        leaf = 0
        while leaf >= 0:
            left = _quantity(codes[leaf, 0], x, y, z)
            if codes[leaf, 1] >= 0:
                left = left / _quantity(codes[leaf, 1], x, y, z)
            op = codes[leaf, 2]
            if op == 0:
                holds = left < values[leaf]
            elif op == 1:
                holds = left <= values[leaf]
            elif op == 2:
                holds = left > values[leaf]
            else:
                holds = left >= values[leaf]
            leaf = codes[leaf, 3] if holds else codes[leaf, 4]
        inside[i] = leaf == _ACCEPT
    return inside
