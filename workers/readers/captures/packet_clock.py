"""When a packet's first laser fired: the sensor's clock for evenness, the host's clock for the moment.

A host stamps a packet when it arrives, some tenths of a millisecond late and unevenly. The sensor counts microseconds
past the hour, evenly, but from GPS, or from when it was switched on. The host's stamp less the sensor's has a sharp
lower edge, the packets that were not delayed; it is followed with room for clocks that drift.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

_HOUR_US: Final = 3_600_000_000
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
        step_us = (device_us - self._device_us) % _HOUR_US
        if step_us > _HOUR_US // 2:
            step_us -= _HOUR_US
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
