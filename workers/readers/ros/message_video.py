"""Video in messages, one encoded frame in each (foxglove.CompressedVideo), decoded into JPEG frames."""

from __future__ import annotations

from typing import Any

import av
import av.error
from av.codec.context import Flags

from workers.readers.images.headers import MAX_PIXELS
from workers.readers.images.video import jpeg_frame
from workers.readers.output import video_is_decoded
from workers.readers.recording import Frame, ReadError
from workers.readers.ros.video_codecs import CODECS, decoder_of


class MessageVideo:
    """Takes the messages of one topic in recorded order and gives its frames.

    Raises:
        ReadError: ``video_unsupported``.
    """

    def __init__(self, codec: str, where: str) -> None:
        decoder = decoder_of(codec)
        if decoder is None:
            raise ReadError(
                "video_unsupported",
                f"{where} holds video as {codec[:20]!r}, which is not read.",
                f"Record it as one of {', '.join(CODECS)}, or as CompressedImage.",
            )
        video_is_decoded()
        self._where = where
        self._context: Any = av.CodecContext.create(decoder, "r")
        self._context.thread_count = 1
        self._context.options = {"max_pixels": str(MAX_PIXELS)}
        self._context.flags |= int(Flags.low_delay)
        self._taken = self._given = 0

    def add(self, stamp_ns: int, data: bytes) -> list[Frame]:
        """The frames that this message completes: mostly its own."""
        self._taken += 1
        packet = av.Packet(data)
        packet.pts = packet.dts = stamp_ns
        return self._decoded(packet)

    def finish(self) -> list[Frame]:
        """The frames that the decoder still holds."""
        return self._decoded(None) if self._taken else []

    def _decoded(self, packet: Any) -> list[Frame]:
        try:
            pictures: list[Any] = self._context.decode(packet)
        except av.error.FFmpegError:  # counted below; frames before the first key frame cannot be decoded
            return []
        shown = [picture for picture in pictures if picture.pts is not None]
        self._given += len(shown)
        return [jpeg_frame(picture, int(picture.pts), self._where) for picture in shown]

    @property
    def missing(self) -> int:
        """The number of frames that could not be decoded so far."""
        return self._taken - self._given
