"""The first message of a topic that tells what the topic holds. Drivers send some before they are ready."""

from __future__ import annotations

from contextlib import suppress
from typing import Final

from workers.readers.clouds.model import SAMPLES
from workers.readers.omissions import Omissions
from workers.readers.recording import MessageError
from workers.readers.ros.camera_info import is_filled
from workers.readers.ros.containers import Container
from workers.readers.ros.topic_messages import BagTopic, CameraInfo, Decoder, Message

_UNFILLED: Final = MessageError(
    "lens_not_stated",
    "Its K is 0 or the identity, or holds what is no number: the camera's driver had not loaded its calibration yet.",
    "Begin to record after the driver has loaded it.",
)


def first_message(container: Container, topic: BagTopic, decoder: Decoder, unfilled: Omissions) -> Message | None:
    """Return the first of a few messages that is filled in, else any; None of a topic without messages.

    ``unfilled`` takes each ``CameraInfo`` that is not.
    """
    filled: Message | None = None
    other: Message | None = None
    for count in (1, SAMPLES):
        total = missing = 0
        for _, raw in container.samples(topic.name, count):
            with suppress(MessageError):
                message = decoder(raw)
                total += 1
                missing += not is_filled(message)
                other = other or message
                filled = filled or (message if is_filled(message) else None)
                if filled is not None and not (missing and isinstance(message, CameraInfo)):
                    return filled
        if filled is not None and missing:
            unfilled.add(topic.name, _UNFILLED, count=missing, total=total, everything=topic.count)
            return filled
    return other
