"""Jobs that one process does one after the other for one message: those that the end of each would have sent."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from typing import Final

from service.platform.jobs.kinds import kind_of
from service.platform.jobs.messages import Message

# Seconds after which no further job is begun for the same message. Who else waits in the queue waits so much longer,
# and a trip through the broker costs a twentieth of it.
HANDFUL_S: Final = 0.2


class Handful:
    """A courier of messages that keeps one of the queue in hand, for its own process to look at next.

    A kept message is a hint as a sent one is: its job is claimed as ever, and sent again where nobody did.
    """

    def __init__(self, send: Callable[[Sequence[Message]], None]) -> None:
        self._send = send
        self._queue, self._ends_at = "", 0.0
        self._next: Message | None = None

    def __call__(self, messages: Sequence[Message]) -> None:
        """Send the messages, but for one that is kept."""
        if self._next is None and time.monotonic() < self._ends_at:
            self._next = next((message for message in messages if kind_of(message.kind).queue == self._queue), None)
        if sent := [message for message in messages if message is not self._next]:
            self._send(sent)

    def after(self, first: Message) -> Iterator[Message]:
        """The message, and while the time lasts the one that was kept each time when its job is done."""
        self._queue, self._ends_at = kind_of(first.kind).queue, time.monotonic() + HANDFUL_S
        message: Message | None = first
        while message:
            self._next = None
            yield message
            message = self._next
        self._ends_at = 0.0
