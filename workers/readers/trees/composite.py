"""Several sources as one recording: their sensors under names of their own, their messages merged by stamp."""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

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


class Composite:
    """A recording of several sources.

    Names are unique: a topic keeps its name where no other source has it, else ``source:topic``; the only sensor of
    a capture or a video is called after the file.
    """

    def __init__(self, parts: Sequence[Part]) -> None:
        self._parts = parts
        self.format = "+".join(sorted({part.recording.format for part in parts}))
        self._places: dict[str, tuple[Part, Sensor]] = {}
        self._sensors: list[Sensor] = []
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
            self._places[unique] = (part, sensor)
            self._sensors.append(replace(sensor, name=unique))

    @property
    def sensors(self) -> Sequence[Sensor]:
        """The sensors of all parts."""
        return self._sensors

    @property
    def other_topics(self) -> Sequence[str]:
        """What the parts hold besides."""
        return [topic for part in self._parts for topic in part.recording.other_topics]

    @property
    def static_transforms(self) -> Sequence[StaticTransform]:
        """Those of all parts; of a frame that is said again the later one counts."""
        stated = (one for part in self._parts for one in part.recording.static_transforms)
        return list({one.child: one for one in stated}.values())

    @property
    def warnings(self) -> list[str]:
        """What the parts say."""
        return [said for part in self._parts for said in part.recording.warnings]

    @property
    def share_read(self) -> float | None:
        """The least of what the parts have read of their bytes."""
        shares = [share for part in self._parts if (share := part.recording.share_read) is not None]
        return min(shares, default=None)

    def lidar_facts(self, sensor: Sensor) -> LidarFacts:
        """What its part learned of a LiDAR."""
        part, inner = self._places[sensor.name]
        return part.recording.lidar_facts(inner)

    def sweeps(self, sensor: Sensor) -> Iterator[Sweep]:
        """The sweeps of one LiDAR."""
        part, inner = self._places[sensor.name]
        return part.recording.sweeps(inner)

    def frames(self, sensor: Sensor) -> Iterator[Frame]:
        """The frames of one camera."""
        part, inner = self._places[sensor.name]
        return part.recording.frames(inner)

    def messages(self, sensors: Sequence[Sensor]) -> Iterator[tuple[Sensor, Sweep | Frame]]:
        """All chosen sensors, each part in one pass, merged by stamp."""
        streams = [self._messages(part, sensors) for part in self._parts]
        return heapq.merge(*streams, key=lambda pair: pair[1].stamp_ns)

    def _messages(self, part: Part, sensors: Sequence[Sensor]) -> Iterator[tuple[Sensor, Sweep | Frame]]:
        outer = {self._places[s.name][1].name: s for s in sensors if self._places[s.name][0] is part}
        if outer:
            inner = [sensor for sensor in part.recording.sensors if sensor.name in outer]
            for sensor, item in part.recording.messages(inner):
                yield outer[sensor.name], item

    def close(self) -> None:
        """Close all parts."""
        for part in self._parts:
            part.recording.close()


def _name(part: Part, sensor: Sensor) -> str:
    if part.named or sensor.name.startswith("/"):
        return sensor.name
    return part.label if len(part.recording.sensors) == 1 else f"{part.label}:{sensor.name}"
