"""What every maker's folder here offers: whose packets are whose, and how those of one sensor become sweeps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, Protocol

from apexcal.documents.readings import ReadOptions
from workers.readers.recording import LidarFacts, Sweep

SAMPLE_PACKETS: Final = 5000
# The columns of every sweep that is made from packets.
FIELDS: Final = "x y z intensity ring time"

# (host's stamp in nanoseconds, payload)
Packet = tuple[int, bytes]


class SweepCutter(Protocol):
    """Takes the packets of one sensor in recorded order and gives its sweeps."""

    def add(self, host_ns: int, data: bytes) -> Sweep | None:
        """Take one packet; the sweep that it ends, where it does."""
        ...

    def finish(self) -> Sweep | None:
        """What is left when the packets have ended: the last sweep, mostly partial."""
        ...

    def warnings(self) -> list[str]:
        """Sentences about what was met while reading."""
        ...


class PacketStream(Protocol):
    """What holds for all packets of one sensor."""

    @property
    def title(self) -> str:
        """The sensor as its maker calls it."""
        ...

    @property
    def sweep_ns(self) -> int:
        """Duration of a turn."""
        ...

    def facts(self, options: ReadOptions) -> LidarFacts:
        """What holds for the whole recording."""
        ...

    def cutter(self, options: ReadOptions) -> SweepCutter:
        """Cut the sensor's packets, from the first one on."""
        ...


class PacketSource(Protocol):
    """A maker's sensors, or one of them, told by their packets.

    ``maker`` is its maker's name.
    """

    maker: str

    def takes(self, payload: bytes) -> bool:
        """Whether a datagram's payload is a packet of measurements of such a sensor."""
        ...

    def learn(self, sample: Sequence[Packet], options: ReadOptions, where: str) -> PacketStream:
        """Learn from the first packets of a sensor how all of them become sweeps.

        Args:
            sample: up to :data:`SAMPLE_PACKETS` packets in recorded order.
            options: what the owner knows.
            where: names the sensor in messages.

        Raises:
            ReadError: ``no_sweeps``, and what the maker's packets may contradict.
        """
        ...
