"""The first look at a recording: its first, a middle and its last message of each sensor, read as ingestion does."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.inspections import RecordingFault
from apexcal.documents.omissions import Omission
from workers.readers.clouds.model import SAMPLES
from workers.readers.images.frame_sizes import FrameSize, other_size, usual_size
from workers.readers.inspected_clocks import sensor_clocks
from workers.readers.normalised.clocks import ClockReport
from workers.readers.normalised.sensor_writers import check_item
from workers.readers.omissions import Omissions
from workers.readers.plausibility import SweepSample, implausible
from workers.readers.recording import Frame, ReadError, Recording, Sensor, Sweep

# Messages of each sensor: more where none of a few can be used.
_COUNTS: Final = (3, SAMPLES)


@dataclass(slots=True)
class FirstLook:
    """The messages that were read of a recording.

    Attributes:
        sensors: by their names; cameras with the size of their frames.
        times: (N,) ascending times of recording of each sensor, ns; the stamps, of a file without an index.
        delays: how long each sensor's messages were underway, seconds.
        clocks: what the sensors' clocks did; empty of a file without times of recording.
        omissions: what cannot be used of the messages that were read.
        doubt: what no LiDAR can have measured.
        refusals: why nothing of a camera can be used, by its name.
    """

    sensors: dict[str, Sensor]
    times: dict[str, NDArray[np.int64]]
    delays: dict[str, float]
    clocks: Mapping[str, ClockReport]
    omissions: list[Omission]
    doubt: RecordingFault | None
    refusals: Mapping[str, ReadError]


@dataclass(slots=True)
class _Contents:
    """The usable part of the messages, by topic: stamps, ns, sizes of frames, and points of the LiDAR."""

    stamps: dict[str, list[int]] = field(default_factory=dict[str, list[int]])
    sizes: dict[str, list[FrameSize]] = field(default_factory=dict[str, list[FrameSize]])
    sweeps: SweepSample = field(default_factory=SweepSample)
    omissions: Omissions = field(default_factory=Omissions)

    def take(self, items: Iterable[tuple[Sensor, Sweep | Frame]]) -> None:
        for sensor, item in items:
            with self.omissions.leaving_out(sensor.name):
                check_item(item, sensor.name)
                self.stamps.setdefault(sensor.name, []).append(item.stamp_ns)
                if isinstance(item, Frame):
                    self.sizes.setdefault(sensor.name, []).append((item.width, item.height))
                else:
                    self.sweeps.add(item)

    def leave_out_sizes(self, topic: str) -> FrameSize | None:
        """The size of most frames; others are left out."""
        sizes, stamps = self.sizes.get(topic), self.stamps.get(topic, [])
        if sizes is None:
            return None
        usual = usual_size(Counter(sizes), None)
        for size, stamp_ns in zip(sizes, stamps, strict=True):
            if size != usual:
                self.omissions.add(topic, other_size(size, usual, stamp_ns), stamp_ns)
        self.stamps[topic] = [stamp_ns for size, stamp_ns in zip(sizes, stamps, strict=True) if size == usual]
        return usual


def look_at(recording: Recording, chosen: Mapping[str, Sensor], *, are_named: bool) -> FirstLook:
    """Read the first, a middle and the last message of each sensor as ingestion does; of a file without an index all.

    ``are_named``: the cameras are those of a rig, and each must serve; else those that do suffice.

    Raises:
        ReadError: ingestion would refuse the recording for what these show.
    """
    logs = {name: log_ns for name, sensor in chosen.items() if (log_ns := recording.log_times(sensor)) is not None}
    contents = _Contents()
    if len(logs) < len(chosen):
        contents.take(recording.messages(list(chosen.values())))
    for sensor in chosen.values() if len(logs) == len(chosen) else ():
        for count in _COUNTS:
            if sensor.name not in contents.stamps:
                contents.take((sensor, item) for item in recording.samples(sensor, count))
    contents.omissions.update(recording.omissions)
    refusals = {
        name: refusal
        for name, sensor in chosen.items()
        if sensor.name not in contents.stamps and (refusal := contents.omissions.refusal(sensor.name)) is not None
    }
    for name, refusal in refusals.items():
        if name == "lidar" or are_named or len(refusals) == len(chosen) - 1:
            raise refusal
    chosen = {name: sensor for name, sensor in chosen.items() if name not in refusals}
    logs = {name: times for name, times in logs.items() if name in chosen}
    sized = {name: _sized(sensor, contents.leave_out_sizes(sensor.name)) for name, sensor in chosen.items()}
    stamps = {name: np.array(contents.stamps.get(sensor.name, []), np.int64) for name, sensor in chosen.items()}
    times, delays, clocks = stamps, dict[str, float](), dict[str, ClockReport]()
    if len(logs) == len(chosen):
        times, delays, clocks = sensor_clocks(recording, chosen, logs)
    steps = np.diff(np.unique(times["lidar"]))
    step_s = float(np.median(steps)) / 1e9 if len(steps) else None
    return FirstLook(
        sized,
        {name: np.sort(each) for name, each in times.items()},
        delays,
        clocks,
        contents.omissions.documents(
            {chosen[name].name: len(each) for name, each in stamps.items()},
            {chosen[name].name: len(each) for name, each in logs.items()},
        ),
        implausible(contents.sweeps, chosen["lidar"].name, step_s),
        refusals,
    )


def _sized(sensor: Sensor, size: tuple[int, int] | None) -> Sensor:
    """A sensor with the size of its frames, whatever the first one has."""
    if size is None:
        return sensor
    return replace(sensor, notes={**sensor.notes, "width": str(size[0]), "height": str(size[1])})
