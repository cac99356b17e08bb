"""From a file's columns to a Sweep: which points are returns, which ring is which, when each was measured.

What holds for a whole recording (order of the rings, unit of the times) is learned once from a few clouds spread
over it, so that a ring keeps its number although it may be empty in one sweep.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.readings import ReadOptions
from workers.readers.clouds.fields import CloudFields, Columns, TimeField
from workers.readers.clouds.point_times import PointTimes, learn_point_times
from workers.readers.clouds.pointcloud2 import empty_cloud
from workers.readers.clouds.ring_spread import check_rings
from workers.readers.clouds.rings import ComputedRings, RingOrder, learn_missing_rings, learn_rings, ring_ids
from workers.readers.clouds.spoilt import check_scale, is_of_scale, usual_scale
from workers.readers.recording import LidarFacts, MessageError, ReadError, Sweep

SAMPLES: Final = 20
_DENSE: Final = 30_000
_NO_RINGS: Final = ("rings_not_separable", "points_without_rings")
# Parts of a cloud by steps of the golden ratio: rows and columns of an organised cloud are met alike.
_PROBES: Final = np.arange(512) * ((5**0.5 - 1) / 2) % 1.0
_CROWD: Final = 5  # more of the probes at one place: a hundredth of the points
_MIX: Final = np.array([1.0, 2**0.5, 3**0.5], np.float32)


class SampleCloud(NamedTuple):
    """A cloud from which is learned: stamp, (N, 3) returns, and the other columns of these returns."""

    stamp_ns: int
    xyz: NDArray[np.float32]
    columns: Columns


@dataclass(slots=True)
class CloudModel:
    """The model by which the clouds of one LiDAR become sweeps.

    Attributes:
        fields: which column holds what.
        ring, intensity, time: those that were chosen; None: there is none. Without a ring, rings are computed.
        rings: the file's ring ids to numbers by elevation, or numbers computed from the points.
        times: how the moment of each point is found.
        notes: sentences about what was found and assumed.
        usual_m: scale of the clouds (:mod:`workers.readers.clouds.spoilt`).
    """

    fields: CloudFields
    ring: str | None
    intensity: str | None
    time: TimeField | None
    rings: RingOrder | ComputedRings
    times: PointTimes
    notes: list[str]
    usual_m: float
    unknown_rings: int = 0
    _needed: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Collect the columns that every cloud must have."""
        optional = (self.ring, self.intensity, *(self.time.names if self.time else ()))
        self._needed = (*self.fields.xyz, *(name for name in optional if name is not None))

    def sweep(self, stamp_ns: int, columns: Columns) -> Sweep:
        """One cloud as a sweep: points without a return dropped, rings by elevation, times from the stamp.

        Raises:
            MessageError: ``cloud_fields_differ``, ``cloud_empty``, ``cloud_malformed``.
        """
        self.fields.check(stamp_ns, columns, self._needed)
        xyz, keep = _returns(columns, self.fields.xyz)
        where = f"{self.fields.where}: the cloud at {stamp_ns / 1e9:.3f} s"
        if not len(xyz):
            raise empty_cloud(where, len(keep))
        check_scale(xyz, self.usual_m, where)
        ring = _numbers(self.rings, xyz, None if self.ring is None else columns[self.ring][keep])
        has_ring = ring >= 0
        if not has_ring.any():
            raise empty_cloud(where, len(keep))
        if not has_ring.all():
            self.unknown_rings += int(np.count_nonzero(~has_ring))
            keep[keep] = has_ring
            xyz, ring = xyz[has_ring], ring[has_ring]
        intensity = np.zeros(len(xyz), np.float32)
        if self.intensity is not None:
            intensity = columns[self.intensity][keep].astype(np.float32)
        time = None if self.time is None else self.time.values(columns)[keep]
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
        """The facts that hold for the whole recording."""
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


def _returns(columns: Columns, axes: Sequence[str]) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """(N, 3) float32 of the points that are returns, and the mask over all points.

    Drivers mark a missing return as NaN or as (0, 0, 0). A transform moves the latter to one other place.
    """
    xyz: NDArray[np.float32] = np.empty((len(columns[axes[0]]), 3), np.float32)
    for axis, name in enumerate(axes):
        xyz[:, axis] = columns[name]
    # Column by column: reducing over an axis of three is ten times slower.
    x, y, z = xyz[:, 0], xyz[:, 1], xyz[:, 2]
    keep: NDArray[np.bool_] = np.isfinite(x) & np.isfinite(y) & np.isfinite(z) & ((x != 0) | (y != 0) | (z != 0))
    empty = _crowded_place(xyz)
    if empty is not None:
        keep &= (x != empty[0]) | (y != empty[1]) | (z != empty[2])
    return (xyz, keep) if keep.all() else (xyz[keep], keep)


def _crowded_place(xyz: NDArray[np.float32]) -> NDArray[np.float32] | None:
    """The place (3,) at which exactly a hundredth or more of the points (N, 3) lie; None where there is none.

    Two returns are hardly ever equal in all bits of three coordinates.
    """
    if len(xyz) < len(_PROBES):
        return None
    probes = xyz[(_PROBES * len(xyz)).astype(np.intp)]
    with np.errstate(over="ignore", invalid="ignore"):  # of a cloud that is misread
        key = probes @ _MIX
    ordered = np.sort(key)
    crowd = ordered[_CROWD:][ordered[_CROWD:] == ordered[:-_CROWD]]
    crowd = crowd[crowd != 0]
    if not len(crowd):
        return None
    places, counts = np.unique(probes[key == crowd[0]], axis=0, return_counts=True)
    return places[np.argmax(counts)] if counts.max() > _CROWD else None


def _rings_of(
    clouds: Sequence[SampleCloud], fields: CloudFields, expected: int | None
) -> tuple[str | None, RingOrder | ComputedRings]:
    """The column that holds the rings, and their order; no column where they are computed.

    Several columns may bear a ring's name. Those come first that are not the same for all points.
    """
    where = fields.where
    if expected == 1:
        return None, learn_missing_rings([cloud.xyz for cloud in clouds], where, expected)
    refusal: ReadError | None = None
    for name in _varying_first(clouds, fields.rings):
        numbered = [(cloud.xyz, ring_ids(cloud.columns[name])) for cloud in clouds]
        try:
            check_rings(numbered, where, name)
        except ReadError as error:
            refusal = refusal or error
            if error.code == "cloud_merged":
                break
        else:
            return name, learn_rings(numbered, where)
    try:
        if refusal is None or refusal.code != "cloud_merged":
            rings = learn_missing_rings([cloud.xyz for cloud in clouds], where, expected)
            return None, rings if refusal is None else replace(rings, note=f"{rings.note} {refusal.message}")
    except ReadError as error:
        refusal = refusal or error
    if refusal.code in _NO_RINGS and fields.unused:
        raise ReadError(refusal.code, f"{refusal.message} {fields.unused}", refusal.hint) from refusal
    raise refusal


def _varying_first(clouds: Sequence[SampleCloud], names: Sequence[str]) -> list[str]:
    """The columns, those last whose value is the same for all points: drivers fill in what they do not measure."""
    if len(names) < 2:
        return list(names)

    def is_constant(name: str) -> bool:
        filled = [values for cloud in clouds if len(values := cloud.columns[name])]
        return bool(filled) and all(bool(np.all(values == filled[0][0])) for values in filled)

    return sorted(names, key=is_constant)


def _usual_clouds(samples: Iterable[tuple[int, Columns]], where: str) -> tuple[CloudFields, list[SampleCloud]]:
    """Return the fields that most of the clouds have, and the returns of those clouds that have them."""
    groups: dict[CloudFields, list[SampleCloud]] = {}
    error: MessageError | None = None
    for stamp_ns, columns in samples:
        try:
            fields = CloudFields.of(columns, where)
            # Every 7th point of a dense cloud tells as much; 7 divides no sensor's number of rings.
            step = 1 if len(columns[fields.xyz[0]]) <= _DENSE else 7
            xyz, keep = _returns({name: columns[name][::step] for name in fields.xyz}, fields.xyz)
            if not len(xyz):
                raise empty_cloud(f"{where}: the cloud at {stamp_ns / 1e9:.3f} s", len(keep))
        except MessageError as reason:
            error = error or reason
            continue
        values = {name: columns[name][::step][keep] for name in fields.candidates}
        groups.setdefault(fields, []).append(SampleCloud(stamp_ns, xyz, values))
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
            ``rings_too_many``, ``points_without_rings``, ``cloud_merged``, ``no_sweeps``.
    """
    fields, clouds = _usual_clouds(samples, where)
    usual_m = usual_scale([cloud.xyz for cloud in clouds])
    clouds = [cloud for cloud in clouds if is_of_scale(cloud.xyz, usual_m)]
    try:
        ring, rings = _rings_of(clouds, fields, options.rings)
    except ReadError as error:
        # Boards that stand still are found without rings, too.
        if options.point_times != "stamp_only" or options.rings is not None or error.code not in _NO_RINGS:
            raise
        ring, rings = _rings_of(clouds, fields, 1)
    intensity = next(iter(_varying_first(clouds, fields.intensities)), None)
    notes = [f"{where}: {rings.note}"] if rings.note else []
    if intensity is None:
        notes.append(f"{where} has no intensity field; intensities are 0.")
    numbers = [_numbers(rings, cloud.xyz, None if ring is None else cloud.columns[ring]) for cloud in clouds]
    time, times = _times_of(clouds, numbers, fields, period_ns, options)
    notes += times.notes
    if fields.unused:
        notes.append(f"{where}: {fields.unused}")
    return CloudModel(fields, ring, intensity, time, rings, times, notes, usual_m)


def _times_of(
    clouds: Sequence[SampleCloud],
    numbers: Sequence[NDArray[np.int32]],
    fields: CloudFields,
    period_ns: int | None,
    options: ReadOptions,
) -> tuple[TimeField | None, PointTimes]:
    """The columns that hold the moment of each point, and how they are read; the first that fit a sweep."""
    first: PointTimes | None = None
    for time in (*fields.times, None)[: max(1, len(fields.times))]:
        samples = [
            (cloud.stamp_ns, None if time is None else time.values(cloud.columns), cloud.xyz, ring)
            for cloud, ring in zip(clouds, numbers, strict=True)
        ]
        times = learn_point_times(samples, period_ns, options, fields.where, time.unit_ns if time else None)
        if times.source == "per_point":
            return time, times
        first = first or times
    assert first is not None
    return None, first
