"""Several sources as one recording: their sensors side by side, or those of a split file one after the other."""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from workers.readers.recording import Frame, LidarFacts, ReadError, Recording, Sensor, StaticTransform, Sweep


@dataclass(frozen=True, slots=True)
class Part:
    """One source.

    Attributes:
        recording: open; the composition closes it.
        label: its path; names its sensor where the source itself gives no topic name.
        named: whether its sensors' names are good as they are.
    """

    recording: Recording
    label: str
    named: bool = False


class _Several(Recording):
    def __init__(self, recordings: Sequence[Recording]) -> None:
        self._recordings = recordings
        self._sensors: list[Sensor] = []

    @property
    def sensors(self) -> Sequence[Sensor]:
        """Those of all parts, each once."""
        return self._sensors

    @property
    def static_transforms(self) -> Sequence[StaticTransform]:
        """Those of all parts; of a frame that is said again the later one counts."""
        return list({one.child: one for part in self._recordings for one in part.static_transforms}.values())

    @property
    def warnings(self) -> list[str]:
        """What the parts say."""
        return [said for part in self._recordings for said in part.warnings]

    def log_times(self, sensor: Sensor) -> NDArray[np.int64] | None:
        """Those of all parts that hold the sensor; None if one of them has no index."""
        times = [each for part, inner in self._sources(sensor) if (each := part.log_times(inner)) is not None]
        return np.concatenate(times) if len(times) == len(self._sources(sensor)) else None

    def log_and_stamp(self, sensor: Sensor, count: int) -> Iterator[tuple[int, int]]:
        """Of the first part that holds the sensor."""
        part, inner = self._sources(sensor)[0]
        return part.log_and_stamp(inner, count)

    def _sources(self, sensor: Sensor) -> list[tuple[Recording, Sensor]]:
        """Each part that holds a sensor, and the sensor as the part names it."""
        raise NotImplementedError

    def close(self) -> None:
        """Close all parts."""
        for part in self._recordings:
            part.close()


class Composite(_Several):
    """A recording of several sources, merged by stamp.

    Names are unique: a topic keeps its name where no other source has it, else ``source:topic``; the only sensor of
    a capture or a video is called after the file.
    """

    def __init__(self, parts: Sequence[Part]) -> None:
        super().__init__([part.recording for part in parts])
        self.format = "+".join(sorted({part.recording.format for part in parts}))
        self._places: dict[str, tuple[Recording, Sensor]] = {}
        owned = [(part, sensor) for part in parts for sensor in part.recording.sensors]
        plain = [_name(part, sensor) for part, sensor in owned]
        for (part, sensor), name in zip(owned, plain, strict=True):
            unique = name if plain.count(name) == 1 else f"{part.label}:{sensor.name}"
            if unique in self._places:
                raise ReadError(
                    "sensors_alike",
                    f"Two sensors are called {unique}.",
                    "Rename one of the files, or put them into folders of their own.",
                )
            self._places[unique] = (part.recording, sensor)
            self._sensors.append(replace(sensor, name=unique))

    @property
    def other_topics(self) -> Sequence[str]:
        """What the parts hold besides."""
        return [topic for part in self._recordings for topic in part.other_topics]

    @property
    def share_read(self) -> float | None:
        """The least of what the parts have read of their bytes."""
        shares = [share for part in self._recordings if (share := part.share_read) is not None]
        return min(shares, default=None)

    def _sources(self, sensor: Sensor) -> list[tuple[Recording, Sensor]]:
        return [self._places[sensor.name]]

    def lidar_facts(self, sensor: Sensor) -> LidarFacts:
        """What its part learned of a LiDAR."""
        part, inner = self._places[sensor.name]
        return part.lidar_facts(inner)

    def messages(self, sensors: Sequence[Sensor]) -> Iterator[tuple[Sensor, Sweep | Frame]]:
        """All chosen sensors, each part in one pass, merged by stamp."""
        streams = [self._messages(part, sensors) for part in self._recordings]
        return heapq.merge(*streams, key=lambda pair: pair[1].stamp_ns)

    def _messages(self, part: Recording, sensors: Sequence[Sensor]) -> Iterator[tuple[Sensor, Sweep | Frame]]:
        outer = {self._places[s.name][1].name: s for s in sensors if self._places[s.name][0] is part}
        if outer:
            inner = [sensor for sensor in part.sensors if sensor.name in outer]
            for sensor, item in part.messages(inner):
                yield outer[sensor.name], item


class Joined(_Several):
    """Files of one recording that was split while it was recorded, one after the other, in the given order.

    Args:
        parts: open, with the same sensors; closed with this.
    """

    def __init__(self, parts: Sequence[Recording]) -> None:
        super().__init__(parts)
        self._done = 0
        self.format = parts[0].format
        for sensor in parts[0].sensors:
            counts = [_of(part, sensor).count for part in parts]
            known = [count for count in counts if count is not None]
            self._sensors.append(replace(sensor, count=sum(known) if len(known) == len(counts) else None))

    @property
    def other_topics(self) -> Sequence[str]:
        """What the first part holds besides."""
        return self._recordings[0].other_topics

    @property
    def warnings(self) -> list[str]:
        """What the parts say, and that they were joined."""
        joined = f"{len(self._recordings)} files with the same topics were read one after the other."
        return [joined, *dict.fromkeys(super().warnings)]

    @property
    def share_read(self) -> float | None:
        """Share of the parts, each taken as equally long."""
        at = self._recordings[min(self._done, len(self._recordings) - 1)].share_read
        return None if at is None else min(1.0, (self._done + at) / len(self._recordings))

    def _sources(self, sensor: Sensor) -> list[tuple[Recording, Sensor]]:
        return [(part, _of(part, sensor)) for part in self._recordings]

    def lidar_facts(self, sensor: Sensor) -> LidarFacts:
        """What the first part learned of a LiDAR.

        Raises:
            ReadError: ``parts_differ`` where another part has other rings.
        """
        owned = self._sources(sensor)
        facts = [part.lidar_facts(inner) for part, inner in owned if inner.count != 0]
        if len({found.ring_count for found in facts}) > 1:
            raise ReadError(
                "parts_differ",
                f"The files of this recording give {sensor.name} different numbers of rings "
                f"({', '.join(str(found.ring_count) for found in facts[:5])}).",
                "Upload the files one by one, or join them with a tool of the format's own.",
            )
        return facts[0] if facts else self._recordings[0].lidar_facts(owned[0][1])

    def messages(self, sensors: Sequence[Sensor]) -> Iterator[tuple[Sensor, Sweep | Frame]]:
        """All chosen sensors, part after part."""
        outer = {sensor.name: sensor for sensor in sensors}
        for number, part in enumerate(self._recordings):
            self._done = number
            for sensor, item in part.messages([_of(part, sensor) for sensor in sensors]):
                yield outer[sensor.name], item


def _of(part: Recording, sensor: Sensor) -> Sensor:
    return next(found for found in part.sensors if (found.kind, found.name) == (sensor.kind, sensor.name))


def _name(part: Part, sensor: Sensor) -> str:
    if part.named or sensor.name.startswith("/"):
        return sensor.name
    return part.label if len(part.recording.sensors) == 1 else f"{part.label}:{sensor.name}"
