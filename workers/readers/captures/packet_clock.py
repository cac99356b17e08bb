"""When a packet's first laser fired: the sensor's clock for evenness, the host's clock for the moment.

A host stamps a packet when it arrives, some tenths of a millisecond late and unevenly. The sensor counts microseconds
past the hour, evenly, but from GPS, or from when it was switched on. The host's stamp less the sensor's has a sharp
lower edge, the packets that were not delayed; it is followed with room for clocks that drift.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

HOUR_US: Final = 3_600_000_000
_PACKET_NS: Final = 1_327_104
_DELAYED_NS: Final = 100_000_000  # a driver may hold packets for a turn and stamp them when it lets them go
# One part in this: no pair of quartz clocks drifts faster than 100 ppm.
_DRIFT: Final = 10_000
_JUMP_NS: Final = 50_000_000
_LATE: Final = 200
_BACK_US: Final = 20_000
_STEP_NS: Final = 500_000_000


@dataclass(slots=True)
class PacketClock:
    """The moments of one sensor's packets on the host's clock; feed it every packet in order.

    Attributes:
        packet_ns: time that a packet's firings take; it is sent when the last is done.
        device: whether the sensor's own stamps are of use; else the host's are taken as they are.
        lead_ns: how much the first packets were delayed against the fastest of the first second.
        jumps: times that one clock was set against the other.
    """

    packet_ns: int
    device: bool
    lead_ns: int = 0
    jumps: int = 0
    _host_ns: int = 0
    _device_us: int = -1
    _device_ns: int = 0
    _anchor_ns: int = 0
    _late: int = 0

    def moment(self, host_ns: int, device_us: int) -> int:
        """Nanoseconds on the host's clock at which the packet's first laser fired."""
        if not self.device:
            return host_ns - self.packet_ns
        if self._device_us < 0:
            self._anchor_ns = host_ns - self.packet_ns - self.lead_ns
            self._host_ns, self._device_us = host_ns, device_us
            return self._anchor_ns
        step_us = (device_us - self._device_us) % HOUR_US
        if step_us > HOUR_US // 2:
            step_us -= HOUR_US
        elapsed_ns = step_us * 1000
        host_step_ns = host_ns - self._host_ns
        self._device_us, self._host_ns = device_us, host_ns
        self._device_ns += elapsed_ns
        difference = host_ns - self.packet_ns - self._device_ns
        if step_us < -_BACK_US or abs(elapsed_ns - host_step_ns) > _STEP_NS:
            self._set(difference)
        else:
            self._follow(difference, elapsed_ns)
        return self._device_ns + self._anchor_ns

    def _follow(self, difference: int, elapsed_ns: int) -> None:
        self._anchor_ns += max(elapsed_ns, 0) // _DRIFT
        above = difference - self._anchor_ns
        if above < 0:
            if above < -_JUMP_NS:
                self.jumps += 1
            self._anchor_ns = difference
            self._late = 0
        elif above > _JUMP_NS:
            self._late += 1
            if self._late > _LATE:
                self._set(difference)
        else:
            self._late = 0

    def _set(self, difference: int) -> None:
        self._anchor_ns = difference
        self._late = 0
        self.jumps += 1


@dataclass(frozen=True, slots=True)
class ClockFacts:
    """The relation between the stamps of a sensor and of its host.

    Attributes:
        packet_ns, device, lead_ns: as :class:`PacketClock` takes them.
        elapsed_ns: from the first packet to the last.
        note: a sentence about it.
    """

    packet_ns: int
    device: bool
    lead_ns: int
    elapsed_ns: float
    note: str

    def clock(self) -> PacketClock:
        """A clock for the sensor's packets, from the first one on."""
        return PacketClock(self.packet_ns, self.device, self.lead_ns)


def learn_clock(host_ns: NDArray[np.int64], device_us: NDArray[np.int64], where: str) -> ClockFacts:
    """Compare the stamps of a sensor's first packets with the host's.

    Args:
        host_ns, device_us: (N,) int64, N > 0, in recorded order; the sensor's own modulo an hour.
        where: names the sensor in messages.
    """
    step_us = np.mod(np.diff(device_us) + HOUR_US // 2, HOUR_US) - HOUR_US // 2
    elapsed = float(host_ns[-1] - host_ns[0])
    turned = float(step_us.sum()) * 1000
    device = bool(
        len(host_ns) > 20
        and np.mean(step_us > 0) > 0.9
        and (elapsed <= 0 or abs(turned - elapsed) < 0.05 * elapsed + _DELAYED_NS)
    )
    if not device:
        note = (
            f"{where}: the sensor's own stamps do not run with the capture's clock; packets have the moments at "
            "which they were captured."
        )
        return ClockFacts(_host_packet_ns(host_ns), False, 0, elapsed, note)
    late = host_ns - np.r_[0, np.cumsum(step_us)] * 1000
    first = np.searchsorted(np.cumsum(step_us), 1_000_000) + 1
    hour = HOUR_US * 1000
    behind = np.mod(device_us * 1000 - host_ns + hour // 2, hour) - hour // 2
    note = (
        f"{where}: times are the host's clock, smoothed by the sensor's. The sensor's clock is "
        f"{float(np.median(behind)) / 1e6:+.1f} ms off the host's, modulo an hour."
    )
    packet_ns = round(float(np.median(step_us)) * 1000)
    return ClockFacts(packet_ns, True, int(late[0] - late[:first].min()), turned, note)


def _host_packet_ns(host_ns: NDArray[np.int64]) -> int:
    steps = np.diff(host_ns)
    usable = steps[(steps > 10_000) & (steps < 10_000_000)]
    return int(np.median(usable)) if len(usable) else _PACKET_NS
