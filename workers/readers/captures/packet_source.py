"""The interface of every maker's folder here: whose packets are whose, and how those of one sensor become sweeps."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Protocol

from apexcal.documents.readings import ReadOptions
from workers.readers.captures.packet_clock import PacketClock
from workers.readers.recording import LidarFacts, Sweep, TimeSource

SAMPLE_PACKETS: Final = 5000
# The columns of every sweep that is made from packets.
FIELDS: Final = "x y z intensity ring time"
_CLOCK_SET: Final = "times the sensor's clock and the host's were set against each other"

# (host's stamp in nanoseconds, payload)
Packet = tuple[int, bytes]


class SweepCutter:
    """Takes the packets of one sensor in recorded order and gives its sweeps.

    Args:
        clock: tells when a packet was measured.
        time_source: of the sweeps.
        where: names the sensor in messages.
    """

    def __init__(self, clock: PacketClock, time_source: TimeSource, where: str) -> None:
        self._clock, self._where = clock, where
        self._time_source: TimeSource = time_source
        self._counts: Counter[str] = Counter()  # of packets, by the sentence that says what was wrong with them

    def add(self, host_ns: int, data: bytes) -> Sweep | None:
        """Take one packet; the sweep that it ends, where it does."""
        raise NotImplementedError

    def finish(self) -> Sweep | None:
        """Return the last sweep, mostly partial, when the packets have ended."""
        raise NotImplementedError

    def warnings(self) -> list[str]:
        """Sentences about what was met while reading."""
        counts = {**self._counts, _CLOCK_SET: self._clock.jumps}
        return [f"{self._where}: {count} {sentence}." for sentence, count in counts.items() if count]


@dataclass(frozen=True, slots=True)
class PacketStream:
    """The facts that hold for all packets of one sensor.

    Attributes:
        title: the sensor as its maker calls it.
        facts: what holds for the whole recording.
        cutter: makes what cuts the sensor's packets, from the first one on.
    """

    title: str
    facts: LidarFacts
    cutter: Callable[[], SweepCutter]


def packet_facts(ring_count: int, sweep_ns: int, notes: Sequence[str], options: ReadOptions) -> LidarFacts:
    """The facts of a sensor whose packets say when each point was measured; stamps are starts of sweeps."""
    source = "stamp_only" if options.point_times == "stamp_only" else "per_point"
    return LidarFacts(ring_count, sweep_ns, "start", source, tuple(notes))


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
