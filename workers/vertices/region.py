"""Region of interest: a JSON tree of inequalities and shapes, compiled to a flat program that one kernel evaluates.

What a region document may say stands in `apexcal.documents.regions`. Boxes become inequalities, turned boxes and
polygons a bounding box and a test of their corners; ``not`` exchanges true and false and costs nothing.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numba as nb
import numpy as np
from numpy.typing import NDArray

from apexcal.documents.analyses import RegionPreview, RingCount
from apexcal.documents.regions import OPERATORS, QUANTITIES, Document, check_region
from workers.readers.recording import Sweep
from workers.vertices.sensor_grid import level_rotation

_ACCEPT: Final = -1
_REJECT: Final = -2
_POLYGON: Final = len(OPERATORS)  # the operator after the last comparison

Node = Mapping[str, Any]


@dataclass(slots=True)
class _Program:
    """Leaves in evaluation order; each names the next leaf for true and for false, or accept / reject.

    codes: quantity, divisor or -1, operator, next if true, next if false. Of a polygon the first two are the number
    of its first corner and of the corner after its last.
    """

    codes: list[tuple[int, int, int, int, int]] = field(default_factory=list[tuple[int, int, int, int, int]])
    values: list[float] = field(default_factory=list[float])
    corners: list[tuple[float, float]] = field(default_factory=list[tuple[float, float]])


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """A checked region of interest in the LiDAR frame (x forward, y left, z up; metres, degrees), or in level axes.

    Azimuth is atan2(y, x), elevation atan2(z, hypot(x, y)), range the Euclidean distance. A quotient by
    zero follows IEEE 754 (infinite or not a number), and a comparison with not-a-number is false. Boxes and the z of
    polygons hold their bounds.
    """

    document: Document
    _codes: NDArray[np.int32]
    _values: NDArray[np.float64]
    _corners: NDArray[np.float64] | None
    _bounds: NDArray[np.float64]
    _R_level_lidar: NDArray[np.float64] | None

    @classmethod
    def from_document(cls, document: object) -> Region:
        """Check and compile a region document.

        Raises:
            RegionError: naming the path of the first bad node, or that the tree is too deep or too large.
        """
        checked = check_region(document)
        program = _Program()
        _compile(_plain(checked.get("level", checked)), _ACCEPT, _REJECT, program)
        return cls(
            checked,
            np.array(program.codes, np.int32),
            np.array(program.values, np.float64),
            np.array(program.corners, np.float64) if program.corners else None,
            _bounds(program),
            level_rotation(_direction(checked["up"])) if "level" in checked else None,
        )

    def mask(self, xyz: NDArray[np.floating[Any]]) -> NDArray[np.bool_]:
        """Which points lie inside.

        Args:
            xyz: (N, 3), metres, LiDAR frame.

        Returns:
            (N,) bool; points with a coordinate that is not finite are never inside.
        """
        if xyz.ndim != 2 or xyz.shape[1] != 3:
            raise ValueError(f"xyz must have shape (N, 3), got {xyz.shape}")
        return _mask(xyz, self._codes, self._values, self._corners, self._bounds, self._R_level_lidar)

    @property
    def fixed_left_out(self) -> bool:
        """A region alone does not know what stands still."""
        return False

    def inside(self, sweep: Sweep) -> NDArray[np.bool_]:
        """Which points (N,) of a sweep lie inside."""
        return self.mask(sweep.xyz)

    def outside(self, sweep: Sweep) -> NDArray[np.bool_]:
        """None: of what is outside it is not known what stands still."""
        return np.zeros(len(sweep.xyz), np.bool_)


def _direction(up: Sequence[float]) -> NDArray[np.float64]:
    direction = np.array(up, np.float64)
    return direction / np.linalg.norm(direction)


def _plain(node: Node) -> Node:
    """The tree with its shapes written as inequalities and bare ``corners``."""
    for name in ("and", "or"):
        if name in node:
            return {name: [_plain(child) for child in node[name]]}
    if "not" in node:
        return {"not": _plain(node["not"])}
    if "polygon" in node:
        return _footprint(node["polygon"], node.get("z"))
    return _box(node["box"]) if "box" in node else node


def _box(box: Node) -> Node:
    (x, y, z), (x_end, y_end, z_end) = box["min"], box["max"]
    yaw = math.radians(box.get("yaw_deg", 0.0))
    if yaw == 0.0:
        return {"and": [*_between("x", x, x_end), *_between("y", y, y_end), *_between("z", z, z_end)]}
    c, s = math.cos(yaw), math.sin(yaw)
    middle = (0.5 * (x + x_end), 0.5 * (y + y_end))
    from_middle = [(a - middle[0], b - middle[1]) for a, b in ((x, y), (x_end, y), (x_end, y_end), (x, y_end))]
    corners = [(middle[0] + c * a - s * b, middle[1] + s * a + c * b) for a, b in from_middle]
    return _footprint(corners, (z, z_end))


def _footprint(corners: Sequence[Sequence[float]], heights: Sequence[float] | None) -> Node:
    xs, ys = [corner[0] for corner in corners], [corner[1] for corner in corners]
    # Most points fail at the bounding box, which costs less than the corners.
    nodes = [*_between("x", min(xs), max(xs)), *_between("y", min(ys), max(ys)), {"corners": corners}]
    return {"and": [*_between("z", *heights), *nodes] if heights else nodes}


def _between(quantity: str, low: float, high: float) -> list[Node]:
    return [{"quantity": quantity, "op": ">=", "value": low}, {"quantity": quantity, "op": "<=", "value": high}]


def _children(node: Node) -> Sequence[Node]:
    return node.get("and") or node.get("or") or ([node["not"]] if "not" in node else ())


def _leaves(node: Node) -> int:
    children = _children(node)
    return sum(_leaves(child) for child in children) if children else 1


def _compile(node: Node, if_true: int, if_false: int, program: _Program) -> None:
    """Append the node's leaves; jump targets make and / or short-circuit without a stack."""
    children = _children(node)
    if not children:
        _append(node, if_true, if_false, program)
        return
    if "not" in node:
        _compile(children[0], if_false, if_true, program)
        return
    conjunction = "and" in node
    for index, child in enumerate(children):
        following = len(program.values) + _leaves(child)
        last = index == len(children) - 1
        go_on = (if_true if conjunction else if_false) if last else following
        if conjunction:
            _compile(child, go_on, if_false, program)
        else:
            _compile(child, if_true, go_on, program)


def _append(leaf: Node, if_true: int, if_false: int, program: _Program) -> None:
    if "corners" in leaf:
        first = len(program.corners)
        program.corners += [(float(x), float(y)) for x, y in leaf["corners"]]
        program.codes.append((first, len(program.corners), _POLYGON, if_true, if_false))
        program.values.append(0.0)
        return
    divisor = QUANTITIES.index(leaf["divided_by"]) if "divided_by" in leaf else -1
    operator = OPERATORS.index(leaf["op"])
    program.codes.append((QUANTITIES.index(leaf["quantity"]), divisor, operator, if_true, if_false))
    program.values.append(float(leaf["value"]))


def _bounds(program: _Program) -> NDArray[np.float64]:
    """(2, 3) least and greatest x, y and z, as the first leaves tell that all points inside must pass."""
    bounds = np.array([[-math.inf] * 3, [math.inf] * 3])
    for leaf, (quantity, divisor, operator, if_true, if_false) in enumerate(program.codes):
        if if_false != _REJECT:
            break
        if operator != _POLYGON and divisor < 0 and quantity < 3:
            above = OPERATORS[operator].startswith(">")
            row, closer = (0, max) if above else (1, min)
            bounds[row, quantity] = closer(float(bounds[row, quantity]), program.values[leaf])
        if if_true != leaf + 1:
            break
    return bounds


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
def _in_polygon(x: float, y: float, corners: NDArray[np.float64], first: int, end: int) -> bool:
    """Even-odd rule: does a ray to the right of (x, y) cross an odd number of sides?"""
    inside = False
    before = end - 1
    for here in range(first, end):
        x0, y0, x1, y1 = corners[before, 0], corners[before, 1], corners[here, 0], corners[here, 1]
        if (y0 > y) != (y1 > y) and x < x0 + (x1 - x0) * (y - y0) / (y1 - y0):
            inside = not inside
        before = here
    return inside


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _mask(
    xyz: NDArray[np.floating[Any]],
    codes: NDArray[np.int32],
    values: NDArray[np.float64],
    corners: NDArray[np.float64] | None,
    bounds: NDArray[np.float64],
    turn: NDArray[np.float64] | None,
) -> NDArray[np.bool_]:
    inside = np.zeros(xyz.shape[0], np.bool_)
    (x_low, y_low, z_low), (x_high, y_high, z_high) = bounds
    for i in range(xyz.shape[0]):
        x, y, z = np.float64(xyz[i, 0]), np.float64(xyz[i, 1]), np.float64(xyz[i, 2])
        if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
            continue
        # Compiled away where the region is in the LiDAR's own axes.
        if turn is not None:
            x, y, z = (
                turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z,
                turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z,
                turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z,
            )
        # Most points fail here, at half of the cost of the leaves.
        if not (x_low <= x <= x_high and y_low <= y <= y_high and z_low <= z <= z_high):
            continue
        leaf = 0
        while leaf >= 0:
            # Compiled away where the region has no polygon: a test more per leaf costs a fifth.
            if corners is not None:  # noqa: SIM102
                if codes[leaf, 2] == _POLYGON:
                    holds = _in_polygon(x, y, corners, codes[leaf, 0], codes[leaf, 1])
                    leaf = codes[leaf, 3] if holds else codes[leaf, 4]
                    continue
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


def preview(sweeps: Iterable[Sweep], region: Region) -> RegionPreview:
    """Count what ``region`` keeps."""
    kept_per_frame: list[int] = []
    points = 0
    all_rings: NDArray[np.int64] = np.zeros(0, np.int64)
    kept_rings: NDArray[np.int64] = np.zeros(0, np.int64)
    for sweep in sweeps:
        inside = region.mask(sweep.xyz)
        kept_per_frame.append(int(np.count_nonzero(inside)))
        points += inside.size
        all_rings = _add(all_rings, sweep.ring)
        kept_rings = _add(kept_rings, sweep.ring[inside])
    kept_rings = np.pad(kept_rings, (0, all_rings.size - kept_rings.size))
    return RegionPreview(
        frames=len(kept_per_frame),
        frames_kept=sum(count > 0 for count in kept_per_frame),
        points=points,
        points_kept=sum(kept_per_frame),
        points_per_frame_median=float(np.median(kept_per_frame)) if kept_per_frame else 0.0,
        per_ring=[
            RingCount(ring=int(ring), points=int(all_rings[ring]), points_kept=int(kept_rings[ring]))
            for ring in np.flatnonzero(all_rings)
        ],
    )


def _add(counts: NDArray[np.int64], ring: NDArray[np.uint16]) -> NDArray[np.int64]:
    more = np.bincount(ring, minlength=counts.size)
    more[: counts.size] += counts
    return more
