"""Files of one recording that was split while it was recorded, one after the other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from workers.readers.recording import Frame, LidarFacts, ReadError, Recording, Sensor, StaticTransform, Sweep


class Joined:
    """Recordings with the same sensors as one, in the given order.

    Args:
        parts: open; closed with this.
    """

    def __init__(self, parts: Sequence[Recording]) -> None:
        self._parts = parts
        self._done = 0
        self.format = parts[0].format
        self._sensors = [replace(sensor, count=_count(parts, sensor)) for sensor in parts[0].sensors]

    @property
    def sensors(self) -> Sequence[Sensor]:
        """Those of the first part, with the counts of all."""
        return self._sensors

    @property
    def other_topics(self) -> Sequence[str]:
        """What the first part holds besides."""
        return self._parts[0].other_topics

    @property
    def static_transforms(self) -> Sequence[StaticTransform]:
        """Those of all parts; of a frame that is said again the later one counts."""
        return list({one.child: one for part in self._parts for one in part.static_transforms}.values())

    @property
    def warnings(self) -> list[str]:
        """What the parts say, and that they were joined."""
        said = [sentence for part in self._parts for sentence in part.warnings]
        return [f"{len(self._parts)} files with the same topics were read one after the other.", *dict.fromkeys(said)]

    @property
    def share_read(self) -> float | None:
        """Share of the parts, each taken as equally long."""
        at = self._parts[min(self._done, len(self._parts) - 1)].share_read
        return None if at is None else min(1.0, (self._done + at) / len(self._parts))

    def lidar_facts(self, sensor: Sensor) -> LidarFacts:
        """What the first part learned of a LiDAR.

        Raises:
            ReadError: ``parts_differ`` where another part has other rings.
        """
        facts = [part.lidar_facts(_of(part, sensor)) for part in self._parts if _of(part, sensor).count != 0]
        if len({found.ring_count for found in facts}) > 1:
            raise ReadError(
                "parts_differ",
                f"The files of this recording give {sensor.name} different numbers of rings "
                f"({', '.join(str(found.ring_count) for found in facts[:5])}).",
                "Upload the files one by one, or join them with a tool of the format's own.",
            )
        return facts[0] if facts else self._parts[0].lidar_facts(_of(self._parts[0], sensor))

    def sweeps(self, sensor: Sensor) -> Iterator[Sweep]:
        """The sweeps of one LiDAR."""
        return (sweep for part in self._parts for sweep in part.sweeps(_of(part, sensor)))

    def frames(self, sensor: Sensor) -> Iterator[Frame]:
        """The frames of one camera."""
        return (frame for part in self._parts for frame in part.frames(_of(part, sensor)))

    def messages(self, sensors: Sequence[Sensor]) -> Iterator[tuple[Sensor, Sweep | Frame]]:
        """All chosen sensors, part after part."""
        outer = {sensor.name: sensor for sensor in sensors}
        for number, part in enumerate(self._parts):
            self._done = number
            for sensor, item in part.messages([_of(part, sensor) for sensor in sensors]):
                yield outer[sensor.name], item

    def close(self) -> None:
        """Close all parts."""
        for part in self._parts:
            part.close()


def _count(parts: Sequence[Recording], sensor: Sensor) -> int | None:
    counts = [_of(part, sensor).count for part in parts]
    known = [count for count in counts if count is not None]
    return sum(known) if len(known) == len(counts) else None


def same(one: Sensor, other: Sensor) -> bool:
    """Whether two files mean the same sensor."""
    return (one.kind, one.name) == (other.kind, other.name)


def _of(part: Recording, sensor: Sensor) -> Sensor:
    return next(found for found in part.sensors if same(found, sensor))
