"""From a file's columns to a Sweep: which points are returns, which ring is which, when each was measured.

What holds for a whole recording (order of the rings, unit of the times) is learned once from a few clouds spread
over it, so that a ring keeps its number although it may be empty in one sweep.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.readings import ReadOptions
from workers.readers.clouds.point_times import TIME_FIELDS, PointTimes, learn_point_times
from workers.readers.clouds.pointcloud2 import empty_cloud
from workers.readers.clouds.ring_spread import check_rings
from workers.readers.clouds.rings import ComputedRings, RingOrder, learn_missing_rings, learn_rings, ring_ids
from workers.readers.recording import LidarFacts, MessageError, ReadError, Sweep

Columns = Mapping[str, NDArray[np.generic]]

RING_FIELDS: Final = ("ring", "channel", "laser_id", "laser_number", "line", "beam")
INTENSITY_FIELDS: Final = ("intensity", "i", "reflectivity", "signal")
SAMPLES: Final = 20
_DENSE: Final = 30_000
_NO_RINGS: Final = ("rings_not_separable", "points_without_rings")
# Stamp, points, ring ids and times.
_Cloud = tuple[int, NDArray[np.float32], NDArray[np.int64] | None, NDArray[np.generic] | None]


def _first(columns: Columns, names: Sequence[str]) -> str | None:
    return next((name for name in names if name in columns), None)


@dataclass(frozen=True, slots=True)
class CloudFields:
    """Which column of a file holds what; without a ring, rings are computed. ``where`` names it in messages."""

    where: str
    ring: str | None
    intensity: str | None
    time: str | None

    @classmethod
    def of(cls, names: Sequence[str], where: str) -> CloudFields:
        """Choose among a file's field names.

        Raises:
            MessageError: ``cloud_without_xyz``.
        """
        listed = ", ".join(names) or "none"
        columns = dict.fromkeys(names, np.zeros(0))
        if any(axis not in columns for axis in "xyz"):
            raise MessageError(
                "cloud_without_xyz",
                f"{where} has no x, y and z; its fields are: {listed}.",
                "Record the LiDAR's point cloud topic, or choose it when ingesting.",
            )
        ring, intensity = _first(columns, RING_FIELDS), _first(columns, INTENSITY_FIELDS)
        return cls(where, ring, intensity, _first(columns, TIME_FIELDS))

    def check(self, stamp_ns: int, columns: Columns) -> None:
        """Hold a cloud against what most have.

        Raises:
            MessageError: ``cloud_fields_differ``.
        """
        needed = ("x", "y", "z", self.ring, self.intensity, self.time)
        missing = [name for name in needed if name is not None and name not in columns]
        if missing:
            listed = " and no ".join(missing)
            raise MessageError(
                "cloud_fields_differ",
                f"{self.where}: the cloud at {stamp_ns / 1e9:.3f} s has no {listed}, which the others have.",
                "Two sensors may share this topic or folder, or the file is damaged: record them apart, or copy it "
                "again.",
            )


@dataclass(slots=True)
class CloudModel:
    """How the clouds of one LiDAR become sweeps.

    Attributes:
        fields: which column holds what.
        rings: the file's ring ids to numbers by elevation, or numbers computed from the points.
        times: how the moment of each point is found.
        notes: sentences about what was found and assumed.
    """

    fields: CloudFields
    rings: RingOrder | ComputedRings
    times: PointTimes
    notes: list[str]
    unknown_rings: int = 0

    def sweep(self, stamp_ns: int, columns: Columns) -> Sweep:
        """One cloud as a sweep: points without a return dropped, rings by elevation, times from the stamp.

        Raises:
            MessageError: ``cloud_fields_differ``, ``cloud_empty``.
        """
        self.fields.check(stamp_ns, columns)
        xyz, keep = _returns(columns)
        if not len(xyz):
            raise empty_cloud(f"{self.fields.where}: the cloud at {stamp_ns / 1e9:.3f} s", len(keep))
        ring = _numbers(self.rings, xyz, None if self.fields.ring is None else columns[self.fields.ring][keep])
        has_ring = ring >= 0
        if not has_ring.all():
            self.unknown_rings += int(np.count_nonzero(~has_ring))
            keep[keep] = has_ring
            xyz, ring = xyz[has_ring], ring[has_ring]
        intensity = np.zeros(len(xyz), np.float32)
        if self.fields.intensity is not None:
            intensity = columns[self.fields.intensity][keep].astype(np.float32)
        time = None if self.fields.time is None else columns[self.fields.time][keep]
        return Sweep(
            stamp_ns=stamp_ns,
            xyz=xyz,
            intensity=intensity,
            ring=ring.astype(np.uint16),
            offset_ns=self.times.offsets(stamp_ns, time, xyz, ring),
            time_source=self.times.source,
        )

    @property
    def facts(self) -> LidarFacts:
        """What holds for the whole recording."""
        return LidarFacts(
            ring_count=self.rings.count,
            sweep_ns=self.times.sweep_ns,
            stamp_convention=self.times.stamp_convention,
            time_source=self.times.source,
            notes=tuple(self.notes),
        )

    def warnings(self) -> list[str]:
        """Sentences about what was met while reading."""
        notes = self.times.warnings()
        if self.unknown_rings and isinstance(self.rings, ComputedRings):
            notes.append(f"{self.unknown_rings} points were left out, because they lie between the computed rings.")
        elif self.unknown_rings:
            notes.append(
                f"{self.unknown_rings} points were left out, because their ring id appears nowhere, or on "
                f"hardly any points, in the {SAMPLES} sweeps from which the order of the rings was learned."
            )
        return notes


def _numbers(
    rings: RingOrder | ComputedRings, xyz: NDArray[np.float32], ids: NDArray[np.generic] | None
) -> NDArray[np.int32]:
    """(N,) int32 ring of each point, -1 where none is known."""
    if isinstance(rings, ComputedRings):
        return rings.number(xyz)
    assert ids is not None
    return rings.number(ids)


def _returns(columns: Columns) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """(N, 3) float32 of the points that are returns, and the mask over all points.

    Drivers mark a missing return as NaN or as (0, 0, 0).
    """
    xyz: NDArray[np.float32] = np.empty((len(columns["x"]), 3), np.float32)
    for axis, name in enumerate("xyz"):
        xyz[:, axis] = columns[name]
    # Column by column: reducing over an axis of three is ten times slower.
    x, y, z = xyz[:, 0], xyz[:, 1], xyz[:, 2]
    keep: NDArray[np.bool_] = np.isfinite(x) & np.isfinite(y) & np.isfinite(z) & ((x != 0) | (y != 0) | (z != 0))
    return (xyz, keep) if keep.all() else (xyz[keep], keep)


def _learned_rings(
    fields: CloudFields, clouds: Sequence[_Cloud], expected: int | None, where: str
) -> RingOrder | ComputedRings:
    if fields.ring is None or expected == 1:
        return learn_missing_rings([xyz for _, xyz, _, _ in clouds], where, expected)
    numbered = [(xyz, ids) for _, xyz, ids, _ in clouds if ids is not None]
    check_rings(numbered, where)
    return learn_rings(numbered, where)


def _usual_clouds(samples: Iterable[tuple[int, Columns]], where: str) -> tuple[CloudFields, list[_Cloud]]:
    """Return the fields that most of the clouds have, and the returns of those clouds that have them."""
    groups: dict[CloudFields, list[_Cloud]] = {}
    error: MessageError | None = None
    for stamp_ns, columns in samples:
        # Every 7th point of a dense cloud tells as much; 7 divides no sensor's number of rings.
        step = 1 if len(columns.get("x", ())) <= _DENSE else 7
        try:
            fields = CloudFields.of(tuple(columns), where)
            xyz, keep = _returns({name: values[::step] for name, values in columns.items()})
            if not len(xyz):
                raise empty_cloud(f"{where}: the cloud at {stamp_ns / 1e9:.3f} s", len(keep))
        except MessageError as reason:
            error = error or reason
            continue
        time = None if fields.time is None else columns[fields.time][::step][keep]
        ids = None if fields.ring is None else ring_ids(columns[fields.ring][::step][keep])
        groups.setdefault(fields, []).append((stamp_ns, xyz, ids, time))
    if not groups:
        raise error or ReadError("no_sweeps", f"{where} holds no sweeps.", "Record again, or choose another topic.")
    return max(groups.items(), key=lambda group: len(group[1]))


def learn_clouds(
    samples: Iterable[tuple[int, Columns]], period_ns: int | None, options: ReadOptions, where: str
) -> CloudModel:
    """Learn what holds for a whole recording from a few of its clouds.

    Args:
        samples: (stamp, columns) of clouds spread over the recording, at least one.
        period_ns: time from one sweep to the next as the file's stamps tell, None where they do not.
        options: what the owner knows.
        where: names the LiDAR in messages.

    Raises:
        ReadError: ``cloud_without_xyz``, ``cloud_fields_differ``, ``rings_not_separable``, ``rings_unexpected``,
            ``rings_too_many``, ``points_without_rings``, ``no_sweeps``.
    """
    fields, clouds = _usual_clouds(samples, where)
    try:
        rings = _learned_rings(fields, clouds, options.rings, where)
    except ReadError as error:
        # Boards that stand still are found without rings, too.
        if options.point_times != "stamp_only" or options.rings is not None or error.code not in _NO_RINGS:
            raise
        rings = _learned_rings(fields, clouds, 1, where)
    notes = [f"{where}: {rings.note}"] if rings.note else []
    if fields.intensity is None:
        notes.append(f"{where} has no intensity field; intensities are 0.")
    times = learn_point_times(
        [(stamp_ns, time, xyz, _numbers(rings, xyz, ids)) for stamp_ns, xyz, ids, time in clouds],
        period_ns,
        options,
        where,
    )
    return CloudModel(fields, rings, times, [*notes, *times.notes])
