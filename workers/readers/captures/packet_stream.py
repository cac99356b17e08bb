"""What holds for all packets of one Velodyne sensor: its model, its clock, its rate and where its turns are cut."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.readings import ReadOptions
from workers.readers.captures.velodyne_models import PACKET, Decoding, find_decoding
from workers.readers.recording import LidarFacts, ReadError

SAMPLE_PACKETS: Final = 5000
TURN: Final = 36_000  # azimuth counts hundredths of a degree
_HOUR_US: Final = 3_600_000_000
_PACKET_NS: Final = 1_327_104
_SWEEP_NS: Final = 100_000_000
_GAP_BINS: Final = 36
_MANY_TURNS: Final = 20
_HELD_NS: Final = 100_000_000  # a driver may hold packets for a turn and stamp them when it lets them go

# (host's stamp in nanoseconds, UDP payload)
Packet = tuple[int, bytes]


@dataclass(frozen=True, slots=True)
class PacketStream:
    """What holds for the packets of one sensor.

    Attributes:
        decoding: its model and how it is decoded.
        seam: azimuth at which sweeps are cut, hundredths of a degree.
        sweep_ns, packet_ns: duration of a turn and of a packet's firings.
        device: whether the sensor's own clock runs evenly with the host's.
        lead_ns: see :class:`workers.readers.captures.packet_clock.PacketClock`.
        notes: sentences about what was found and assumed.
    """

    decoding: Decoding
    seam: int
    sweep_ns: int
    packet_ns: int
    device: bool
    lead_ns: int
    notes: Sequence[str]

    def facts(self, options: ReadOptions) -> LidarFacts:
        """What holds for the whole recording."""
        source = "stamp_only" if options.point_times == "stamp_only" else "per_point"
        return LidarFacts(self.decoding.model.rings, self.sweep_ns, "start", source, tuple(self.notes))


def learn_packets(sample: Sequence[Packet], options: ReadOptions, where: str) -> PacketStream:
    """Learn from the first packets of a sensor how all of them become sweeps.

    Args:
        sample: up to :data:`SAMPLE_PACKETS` data packets in recorded order, at least one.
        options: what the owner knows.
        where: names the sensor in messages.

    Raises:
        ReadError: ``no_sweeps``, and what :func:`find_decoding` raises.
    """
    if not sample:
        raise ReadError("no_sweeps", f"{where} holds no packets.", "Record again, or choose another sensor.")
    decoding = find_decoding([data for _, data in sample], options.lidar_model, where)
    host = np.array([stamp for stamp, _ in sample], np.int64)
    rows = np.array([PACKET.unpack(data) for _, data in sample], np.int64)
    azimuth, device_us = rows[:, 1:24:2] % TURN, rows[:, 24]
    step_us = np.mod(np.diff(device_us) + _HOUR_US // 2, _HOUR_US) - _HOUR_US // 2
    elapsed = float(host[-1] - host[0])
    device_ok = bool(
        len(sample) > 20
        and np.mean(step_us > 0) > 0.9
        and (elapsed <= 0 or abs(float(step_us.sum()) * 1000 - elapsed) < 0.05 * elapsed + _HELD_NS)
    )
    notes = list(decoding.notes)
    packet_ns = round(float(np.median(step_us)) * 1000) if device_ok else _host_packet_ns(host)
    lead_ns = 0
    if device_ok:
        late = host - np.r_[0, np.cumsum(step_us)] * 1000
        first = np.searchsorted(np.cumsum(step_us), 1_000_000) + 1
        lead_ns = int(late[0] - late[:first].min())
        notes.append(_clock_note(host, device_us, where))
    else:
        notes.append(
            f"{where}: the sensor's own stamps do not run with the capture's clock; packets have the moments at "
            "which they were captured."
        )
    # By the clock and not by the count of packets: a sensor that is set to a sector is silent outside of it.
    turned_ns = float(step_us.sum()) * 1000 if device_ok else elapsed
    sweep_ns = _sweep_duration(azimuth, turned_ns, options)
    seam, cut = _seam(azimuth)
    notes.append(f"{where}: sweeps are cut at azimuth {seam / 100:.2f} degrees, {cut}; stamps are their starts.")
    return PacketStream(decoding, seam, sweep_ns, packet_ns, device_ok, lead_ns, notes)


def evened(last_ns: int, payloads: Sequence[bytes]) -> list[Packet]:
    """Packets that came together, with a stamp for the last alone: the sensor's clock tells the others."""
    device_us = [PACKET.unpack(data)[24] for data in payloads]
    return [
        (last_ns - (device_us[-1] - at) % _HOUR_US * 1000, data) for at, data in zip(device_us, payloads, strict=True)
    ]


def _host_packet_ns(host: NDArray[np.int64]) -> int:
    steps = np.diff(host)
    usable = steps[(steps > 10_000) & (steps < 10_000_000)]
    return int(np.median(usable)) if len(usable) else _PACKET_NS


def _clock_note(host: NDArray[np.int64], device_us: NDArray[np.int64], where: str) -> str:
    hour = _HOUR_US * 1000
    behind = np.mod(device_us * 1000 - host + hour // 2, hour) - hour // 2
    return (
        f"{where}: times are the capture's (the host's clock), evened by the sensor's own; the sensor's clock reads "
        f"{float(np.median(behind)) / 1e6:+.1f} ms against the host's, modulo an hour."
    )


def _sweep_duration(azimuth: NDArray[np.int64], elapsed_ns: float, options: ReadOptions) -> int:
    if options.rate_hz is not None:
        return round(1e9 / options.rate_hz)
    starts = azimuth[:, 0]
    turned = float(np.mod(np.diff(starts), TURN).sum()) / TURN
    if len(starts) < 10 or turned < 0.2:
        return _SWEEP_NS
    sweep_ns = round(elapsed_ns / turned)
    return sweep_ns if 1e7 < sweep_ns < 2e9 else _SWEEP_NS


def _seam(azimuth: NDArray[np.int64]) -> tuple[int, str]:
    """Where to cut: in the middle of the field that the sensor does not send, else behind it, where vehicles and
    people stand least; but where a short recording begins, so that its first turn is whole.
    """
    sent = np.bincount(azimuth.reshape(-1) // (TURN // _GAP_BINS), minlength=_GAP_BINS)[:_GAP_BINS] > 0
    turned = float(np.mod(np.diff(azimuth[:, 0]), TURN).sum()) / TURN
    if turned > 1.5 and not sent.all():
        doubled = np.r_[sent, sent]
        best, length, run = 0, 0, 0
        for index, on in enumerate(doubled.tolist()):
            run = 0 if on else run + 1
            if run > length:
                best, length = index, run
        middle = (best + 1 - length / 2) * (TURN // _GAP_BINS)
        return int(middle) % TURN, "in the middle of the field that it does not send"
    if turned > _MANY_TURNS or len(azimuth) >= SAMPLE_PACKETS:
        return TURN // 2, "behind the sensor"
    return int(azimuth[0, 0]), "where the recording begins"
