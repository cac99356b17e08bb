"""A recording of topics that was split into several files while it was recorded."""

from __future__ import annotations

from collections.abc import Sequence

from apexcal.documents.readings import ReadOptions
from workers.readers.recording import LidarFacts, ReadError, Sensor
from workers.readers.ros.containers import SplitContainer
from workers.readers.ros.topics import TopicRecording


class SplitBag(TopicRecording):
    """Files of one recording that was split while it was recorded, one after the other, in the given order.

    Args:
        parts: open, with the same topics; closed with this.
    """

    def __init__(self, parts: Sequence[TopicRecording], options: ReadOptions) -> None:
        super().__init__(SplitContainer([part._container for part in parts]), options)
        self._parts = parts

    @property
    def warnings(self) -> list[str]:
        """Sentences about what was met, and that the files were joined."""
        return [f"{len(self._parts)} files with the same topics were read one after the other.", *super().warnings]

    def lidar_facts(self, sensor: Sensor) -> LidarFacts:
        """See :class:`TopicRecording`.

        Raises:
            ReadError: ``parts_differ`` where the files have different rings.
        """
        same = [(part, s) for part in self._parts for s in part.sensors if s.name == sensor.name and s.count != 0]
        counts = list(dict.fromkeys(part.lidar_facts(here).ring_count for part, here in same))
        if len(counts) > 1:
            raise ReadError(
                "parts_differ",
                f"The files of this recording give {sensor.name} different numbers of rings "
                f"({', '.join(map(str, counts[:5]))}).",
                "Upload the files one by one, or join them with a tool of the format's own.",
            )
        return super().lidar_facts(sensor)
