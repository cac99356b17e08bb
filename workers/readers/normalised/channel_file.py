"""An MCAP file of one sensor: one channel of ROS 2 messages."""

from __future__ import annotations

from pathlib import Path

from workers.readers.mcap_writing.chunked_file import ChunkedFile, Part


class ChannelFile:
    """An MCAP file with one channel, while it is written.

    Args:
        path: is made, or overwritten.
        topic: of the one channel; its messages are CDR.
        schema: name and text of the message type, in ROS 2's notation.
        level: zstd level of the chunks; None: not compressed, so that each message is a byte range of the file.
    """

    def __init__(self, path: Path, topic: str, schema: tuple[str, str], level: int | None) -> None:
        self.path = path
        self._file = ChunkedFile(path, "ros2", level)
        self._channel = self._file.add_channel(
            topic, self._file.add_schema(schema[0], "ros2msg", schema[1].encode()), "cdr"
        )

    @property
    def count(self) -> int:
        """Number of messages."""
        return self._file.count(self._channel)

    def add(self, stamp_ns: int, *message: Part) -> None:
        """Append one message, given in parts; they must not change before the file is finished."""
        self._file.add(self._channel, stamp_ns, *message)

    def finish(self, metadata_name: str, facts: dict[str, str]) -> None:
        """Write the metadata record and the summary, and close."""
        self._file.finish(metadata_name, facts)

    def abandon(self) -> None:
        """Close without finishing; what is on disk is of no use."""
        self._file.abandon()
