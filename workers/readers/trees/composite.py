"""Several sources as one recording, their sensors side by side."""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.recordings import FixedFrame
from workers.readers.omissions import Omissions
from workers.readers.recording import Frame, LidarFacts, ReadError, Recording, Sensor, Sweep


@dataclass(frozen=True, slots=True)
class TreePart:
    """A recording in a tree.

    Attributes:
        recording: open; the composition closes it.
        label: its path; names its sensor where the source itself gives no topic name.
        named: whether its sensors' names are good as they are.
    """

    recording: Recording
    label: str
    named: bool = False


class Composite(Recording):
    """A recording of several sources, merged by stamp.

    Names are unique: a topic keeps its name where no other source has it, else ``source:topic``; the only sensor of
    a capture or a video is called after the file.

    Raises:
        ReadError: ``sensors_alike``.
    """

    def __init__(self, parts: Sequence[TreePart]) -> None:
        self._recordings = [part.recording for part in parts]
        self.format = "+".join(sorted({recording.format for recording in self._recordings}))
        self._inner: dict[str, tuple[Recording, Sensor]] = {}
        self.other_topics = [topic for recording in self._recordings for topic in recording.other_topics]
        sensors: list[Sensor] = []
        names = Counter(_name(part, sensor) for part in parts for sensor in part.recording.sensors)
        for part in parts:
            for sensor in part.recording.sensors:
                name = _name(part, sensor)
                unique = name if names[name] == 1 else f"{part.label}:{sensor.name}"
                if unique in self._inner:
                    raise ReadError(
                        "sensors_alike",
                        f"Two sensors are called {unique}.",
                        "Rename one of the files, or put them into folders of their own.",
                    )
                self._inner[unique] = (part.recording, sensor)
                sensors.append(replace(sensor, name=unique))
        self.sensors = sensors

    @property
    def static_transforms(self) -> Sequence[FixedFrame]:
        """The transforms of all parts; a frame's later transform replaces the earlier one."""
        return list(
            {transform.child: transform for part in self._recordings for transform in part.static_transforms}.values()
        )

    @property
    def warnings(self) -> list[str]:
        """The warnings of all parts."""
        return [line for part in self._recordings for line in part.warnings]

    @property
    def share_read(self) -> float | None:
        """The least of what the parts have read of their bytes."""
        return min((s for part in self._recordings if (s := part.share_read) is not None), default=None)

    @property
    def omissions(self) -> Omissions:
        """The omissions of all parts, under this recording's names."""
        every = Omissions()
        for part in self._recordings:
            every.update(part.omissions, {s.name: name for name, (of, s) in self._inner.items() if of is part})
        return every

    def samples(self, sensor: Sensor, count: int) -> Iterator[Sweep | Frame]:
        """Yield the samples of the sensor's part."""
        part, inner = self._inner[sensor.name]
        return part.samples(inner, count)

    def log_times(self, sensor: Sensor) -> NDArray[np.int64] | None:
        """Return the times of the sensor's part."""
        part, inner = self._inner[sensor.name]
        return part.log_times(inner)

    def log_and_stamp(self, sensor: Sensor, count: int) -> Iterator[tuple[int, int]]:
        """Yield the times and stamps of the sensor's part."""
        part, inner = self._inner[sensor.name]
        return part.log_and_stamp(inner, count)

    def stamps(self, sensors: Sequence[Sensor]) -> Iterator[tuple[Sensor, int, int]]:
        """Yield the stamps of all parts, one part after the other."""
        for part in self._recordings:
            outer = {inner.name: s for s in sensors for of, inner in [self._inner[s.name]] if of is part}
            for sensor, stamp_ns, log_ns in part.stamps([s for s in part.sensors if s.name in outer]):
                yield outer[sensor.name], stamp_ns, log_ns

    def lidar_facts(self, sensor: Sensor) -> LidarFacts:
        """The facts that its part learned of a LiDAR."""
        part, inner = self._inner[sensor.name]
        return part.lidar_facts(inner)

    def messages(self, sensors: Sequence[Sensor]) -> Iterator[tuple[Sensor, Sweep | Frame]]:
        """All chosen sensors, each part in one pass, merged by stamp."""
        streams = [self._messages(part, sensors) for part in self._recordings]
        return heapq.merge(*streams, key=lambda pair: pair[1].stamp_ns)

    def _messages(self, part: Recording, sensors: Sequence[Sensor]) -> Iterator[tuple[Sensor, Sweep | Frame]]:
        outer = {self._inner[s.name][1].name: s for s in sensors if self._inner[s.name][0] is part}
        if outer:
            inner = [sensor for sensor in part.sensors if sensor.name in outer]
            for sensor, item in part.messages(inner):
                yield outer[sensor.name], item

    def close(self) -> None:
        """Close all parts."""
        for part in self._recordings:
            part.close()


def _name(part: TreePart, sensor: Sensor) -> str:
    if part.named or sensor.name.startswith("/"):
        return sensor.name
    return part.label if len(part.recording.sensors) == 1 else f"{part.label}:{sensor.name}"
