"""The region of interest as tables of its parts, which one kernel evaluates for each point.

`apexcal.documents.regions` defines the region document. Boxes become inequalities; turned boxes and polygons become a
bounding box and a test of their corners. A part holds if all its tests hold.
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

_POLYGON: Final = len(OPERATORS)  # the operator after the last comparison

Node = Mapping[str, Any]


@dataclass(slots=True)
class _Tables:
    """The parts of a region as tables for the kernel.

    Attributes:
        tests: quantity, divisor or -1, operator. For a polygon the first two are the index of its first corner and of
            the corner after its last.
        values: that the quantity of each test is compared with.
        corners: of all polygons.
        parts: the index of the test after the part's last, and whether the part must hold.
    """

    tests: list[tuple[int, int, int]] = field(default_factory=list[tuple[int, int, int]])
    values: list[float] = field(default_factory=list[float])
    corners: list[tuple[float, float]] = field(default_factory=list[tuple[float, float]])
    parts: list[tuple[int, bool]] = field(default_factory=list[tuple[int, bool]])

    def append(self, part: Node, must_hold: bool) -> None:
        """Append a part of a document."""
        if "polygon" in part:
            self._append_footprint(part["polygon"], part.get("z"))
        elif "box" in part:
            self._append_box(part["box"])
        else:
            divisor = QUANTITIES.index(part["divided_by"]) if "divided_by" in part else -1
            self.tests.append((QUANTITIES.index(part["quantity"]), divisor, OPERATORS.index(part["op"])))
            self.values.append(float(part["value"]))
        self.parts.append((len(self.tests), must_hold))

    def _append_box(self, box: Node) -> None:
        (x, y, z), (x_end, y_end, z_end) = box["min"], box["max"]
        yaw = math.radians(box.get("yaw_deg", 0.0))
        if yaw == 0.0:
            for quantity, low, high in zip(range(3), box["min"], box["max"], strict=True):
                self._append_span(quantity, low, high)
            return
        c, s = math.cos(yaw), math.sin(yaw)
        middle = (0.5 * (x + x_end), 0.5 * (y + y_end))
        from_middle = [(a - middle[0], b - middle[1]) for a, b in ((x, y), (x_end, y), (x_end, y_end), (x, y_end))]
        corners = [(middle[0] + c * a - s * b, middle[1] + s * a + c * b) for a, b in from_middle]
        self._append_footprint(corners, (z, z_end))

    def _append_footprint(self, corners: Sequence[Sequence[float]], heights: Sequence[float] | None) -> None:
        if heights:
            self._append_span(2, *heights)
        # Most points fail at the bounding box, which costs less than the corners.
        for axis in range(2):
            along = [corner[axis] for corner in corners]
            self._append_span(axis, min(along), max(along))
        first = len(self.corners)
        self.corners += [(float(x), float(y)) for x, y in corners]
        self.tests.append((first, len(self.corners), _POLYGON))
        self.values.append(0.0)

    def _append_span(self, quantity: int, low: float, high: float) -> None:
        self.tests += [(quantity, -1, OPERATORS.index(">=")), (quantity, -1, OPERATORS.index("<="))]
        self.values += [float(low), float(high)]

    def bounds(self) -> NDArray[np.float64]:
        """Return (2, 3) least and greatest x, y and z inside, by the parts that must hold."""
        bounds = np.array([[-math.inf] * 3, [math.inf] * 3])
        first = 0
        for end, must_hold in self.parts:
            for (quantity, divisor, operator), value in list(zip(self.tests, self.values, strict=True))[first:end]:
                if must_hold and operator != _POLYGON and divisor < 0 and quantity < 3:
                    row, closer = (0, max) if OPERATORS[operator].startswith(">") else (1, min)
                    bounds[row, quantity] = closer(float(bounds[row, quantity]), value)
            first = end
        return bounds


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """A checked region of interest in the LiDAR frame (x forward, y left, z up; metres, degrees), or in level axes.

    Azimuth is atan2(y, x), elevation atan2(z, hypot(x, y)), range the Euclidean distance. A quotient by zero follows
    IEEE 754 (infinite or not a number), and a comparison with not-a-number is false. Bounds of boxes and the z bounds
    of polygons lie inside.
    """

    document: Document
    _tests: NDArray[np.int32]
    _parts: NDArray[np.int32]
    _values: NDArray[np.float64]
    _corners: NDArray[np.float64] | None
    _bounds: NDArray[np.float64]
    _R_level_lidar: NDArray[np.float64] | None

    @classmethod
    def from_document(cls, document: object) -> Region:
        """Check a region document and make the kernel's tables of it.

        Raises:
            RegionError: naming the path of the first bad part.
        """
        checked = check_region(document)
        tables = _Tables()
        for member, must_hold in (("all", True), ("none", False)):
            for part in checked.get(member, ()):
                tables.append(part, must_hold)
        return cls(
            checked,
            np.array(tables.tests, np.int32),
            np.array(tables.parts, np.int32),
            np.array(tables.values, np.float64),
            np.array(tables.corners, np.float64) if tables.corners else None,
            tables.bounds(),
            level_rotation(_direction(checked["up"])) if "up" in checked else None,
        )

    def mask(self, xyz: NDArray[np.floating[Any]]) -> NDArray[np.bool_]:
        """Return which points lie inside.

        Args:
            xyz: (N, 3), metres, LiDAR frame.

        Returns:
            (N,) bool; points with a coordinate that is not finite are never inside.
        """
        if xyz.ndim != 2 or xyz.shape[1] != 3:
            raise ValueError(f"xyz must have shape (N, 3), got {xyz.shape}")
        return _mask(xyz, self._tests, self._parts, self._values, self._corners, self._bounds, self._R_level_lidar)

    @property
    def fixed_left_out(self) -> bool:
        """False: a region alone has no background to leave out."""
        return False

    def inside(self, sweep: Sweep) -> NDArray[np.bool_]:
        """Return which points (N,) of a sweep lie inside."""
        return self.mask(sweep.xyz)

    def outside(self, sweep: Sweep) -> NDArray[np.bool_]:
        """Return no points: a region alone cannot show which points outside of it are static."""
        return np.zeros(len(sweep.xyz), np.bool_)


def _direction(up: Sequence[float]) -> NDArray[np.float64]:
    direction = np.array(up, np.float64)
    return direction / np.linalg.norm(direction)


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
    """Return whether a ray to the right of (x, y) crosses an odd number of sides (even-odd rule)."""
    inside = False
    before = end - 1
    for here in range(first, end):
        x0, y0, x1, y1 = corners[before, 0], corners[before, 1], corners[here, 0], corners[here, 1]
        if (y0 > y) != (y1 > y) and x < x0 + (x1 - x0) * (y - y0) / (y1 - y0):
            inside = not inside
        before = here
    return inside


@nb.njit(nogil=True, cache=True, error_model="numpy", inline="always")
def _holds(
    x: float,
    y: float,
    z: float,
    test: NDArray[np.int32],
    value: float,
    corners: NDArray[np.float64] | None,
) -> bool:
    # Compiled away if the region has no polygon: one more test each time costs a fifth.
    if corners is not None:  # noqa: SIM102
        if test[2] == _POLYGON:
            return _in_polygon(x, y, corners, test[0], test[1])
    left = _quantity(test[0], x, y, z)
    if test[1] >= 0:
        left = left / _quantity(test[1], x, y, z)
    if test[2] == 0:
        return left < value
    if test[2] == 1:
        return left <= value
    if test[2] == 2:
        return left > value
    return left >= value


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _mask(
    xyz: NDArray[np.floating[Any]],
    tests: NDArray[np.int32],
    parts: NDArray[np.int32],
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
        # Compiled away if the region is in the LiDAR's own axes.
        if turn is not None:
            x, y, z = (
                turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z,
                turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z,
                turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z,
            )
        # Most points fail here, at half of the cost of the tests.
        if not (x_low <= x <= x_high and y_low <= y <= y_high and z_low <= z <= z_high):
            continue
        keep = True
        test = 0
        for part in range(parts.shape[0]):
            holds = True
            while holds and test < parts[part, 0]:
                holds = _holds(x, y, z, tests[test], values[test], corners)
                test += 1
            if holds != (parts[part, 1] == 1):
                keep = False
                break
            test = parts[part, 0]
        inside[i] = keep
    return inside


def preview(sweeps: Iterable[Sweep], region: Region) -> RegionPreview:
    """Return how many points and frames ``region`` keeps."""
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
