"""Sweeps from the packets of one Velodyne sensor: cut at the seam, decoded by velodyne-decoder.

A sweep is one turn from seam to seam, to the laser: a packet across the seam is decoded twice and each half kept
once, so that no point is in two sweeps and none is lost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from workers.readers.packet_clock import PacketClock
from workers.readers.recording import LidarFacts, ReadError, ReadOptions, Sweep
from workers.readers.velodyne_models import BLOCKS, DUAL, PACKET, Decoding, find_decoding

FIELDS: Final = "x y z intensity ring time"
SAMPLE_PACKETS: Final = 5000
_TURN: Final = 36_000  # azimuth counts hundredths of a degree
_BACK: Final = 1_000
_HOUR_US: Final = 3_600_000_000
_PACKET_NS: Final = 1_327_104
_SWEEP_NS: Final = 100_000_000
_GAP_BINS: Final = 36
# Less than the time from one laser to the next, 1.2 us at least, and more than float32 seconds lose.
_MARGIN_NS: Final = 200

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
        lead_ns: see :class:`PacketClock`.
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
    azimuth, device_us = rows[:, 1:24:2] % _TURN, rows[:, 24]
    step_us = np.mod(np.diff(device_us) + _HOUR_US // 2, _HOUR_US) - _HOUR_US // 2
    elapsed = float(host[-1] - host[0])
    device_ok = bool(
        len(sample) > 20
        and np.mean(step_us > 0) > 0.9
        and (elapsed <= 0 or abs(float(step_us.sum()) * 1000 - elapsed) < 0.05 * elapsed + 2e7)
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
    turned = float(np.mod(np.diff(starts), _TURN).sum()) / _TURN
    if len(starts) < 10 or turned < 0.2:
        return _SWEEP_NS
    sweep_ns = round(elapsed_ns / turned)
    return sweep_ns if 1e7 < sweep_ns < 2e9 else _SWEEP_NS


def _seam(azimuth: NDArray[np.int64]) -> tuple[int, str]:
    """Where to cut: in the middle of the field that the sensor does not send, else where the recording begins."""
    sent = np.bincount(azimuth.reshape(-1) // (_TURN // _GAP_BINS), minlength=_GAP_BINS)[:_GAP_BINS] > 0
    turned = float(np.mod(np.diff(azimuth[:, 0]), _TURN).sum()) / _TURN
    if turned > 1.5 and not sent.all():
        doubled = np.r_[sent, sent]
        best, length, run = 0, 0, 0
        for place, on in enumerate(doubled.tolist()):
            run = 0 if on else run + 1
            if run > length:
                best, length = place, run
        middle = (best + 1 - length / 2) * (_TURN // _GAP_BINS)
        return int(middle) % _TURN, "in the middle of the field that it does not send"
    return int(azimuth[0, 0]), "where the recording begins"


class SweepCutter:
    """Takes the packets of one sensor in recorded order and gives its sweeps."""

    def __init__(self, stream: PacketStream, options: ReadOptions, where: str) -> None:
        velodyne: Any = import_module("velodyne_decoder")
        library: Any = import_module("velodyne_decoder.velodyne_decoder_pylib")
        self._time_pair: Any = library.TimePair
        self._packet: Any = velodyne.VelodynePacket
        self._vector: Any = velodyne.PacketVector
        self._decoder: Any = velodyne.ScanDecoder(stream.decoding.config)
        self._stream = stream
        self._where = where
        self._stamp_only = options.point_times == "stamp_only"
        self._clock = PacketClock(stream.packet_ns, stream.device, stream.lead_ns)
        self._held: list[Packet] = []
        self._start_ns = 0
        self._phase = -1  # azimuth from the seam, and moment, of the last firing cycle
        self._cycle_at = 0
        self._last_data = b""
        self._damaged = self._twins = self._disordered = self._lost = self._stalled = 0

    def add(self, host_ns: int, data: bytes) -> Sweep | None:
        """Take one packet; the sweep that it ends, where it does."""
        fields = PACKET.unpack(data)
        stream, model = self._stream, self._stream.decoding.model
        azimuths = fields[1:24:2]
        if stream.decoding.patch:
            data = data[:-2] + stream.decoding.patch
        if (
            not model.flags.issuperset(fields[:24:2])
            or max(azimuths) >= _TURN
            or (model.product is not None and data[-1] != model.product)
        ):
            self._damaged += 1
            return None
        if data == self._last_data:
            self._twins += 1
            return None
        moment = self._clock.moment(host_ns, fields[24])
        phases = [(azimuth - stream.seam) % _TURN for azimuth in azimuths]
        gap_ns = moment - self._held[-1][0] if self._held else 0
        if gap_ns < 0:
            self._disordered += 1
            return None
        self._last_data = data
        return self._cut(moment, data, phases, gap_ns)

    def _cut(self, moment: int, data: bytes, phases: list[int], gap_ns: int) -> Sweep | None:
        """Hold a packet, and close the sweep where it crosses the seam or comes too late to belong to it."""
        stream = self._stream
        if gap_ns > 1.5 * stream.packet_ns and phases[0] > self._phase:
            self._lost += round(gap_ns / stream.packet_ns) - 1
        if not self._held:
            self._start_ns = moment - stream.decoding.model.early_ns
        crossing = None
        stalled = bool(self._held) and moment - self._start_ns > 2.5 * stream.sweep_ns
        if self._held and (gap_ns > 0.75 * stream.sweep_ns or stalled):
            self._stalled += stalled
            crossing = moment - stream.decoding.model.early_ns
        crossing = self._crossing(moment, data, phases, crossing)
        packet = (moment, data)
        done: Sweep | None = None
        if crossing is None:
            self._held.append(packet)
        elif self._held and crossing < moment - stream.decoding.model.early_ns:
            across = self._held[-1]
            done = self._close(crossing)
            self._held = [across, packet]
        else:
            self._held.append(packet)
            done = self._close(crossing)
            self._held = [packet]
        return done

    def _crossing(self, moment: int, data: bytes, phases: list[int], forced: int | None) -> int | None:
        """The moment at which the sensor passes the seam in this packet or just before it, None where it does not."""
        model = self._stream.decoding.model
        # An HDL-64E shows dual return by sending an azimuth twice.
        dual = data[2:4] == data[202:204] if model.product is None else data[-2] == DUAL
        width = model.blocks * (1 + dual)
        last = (BLOCKS // width - 1) * width
        before, before_ns = self._phase, self._cycle_at
        self._phase = phases[last]
        self._cycle_at = moment - model.early_ns + round(last // width * model.cycle_ns)
        if forced is not None or (before <= phases[0] <= phases[last] and before >= 0):
            return forced
        for unit, phase in enumerate(phases[: last + 1 : width]):
            at_ns = moment - model.early_ns + round(unit * model.cycle_ns)
            if before >= 0 and phase < before - _BACK:
                if at_ns - before_ns > 2 * model.cycle_ns:
                    return at_ns
                return before_ns + (at_ns - before_ns) * (_TURN - before) // (_TURN - before + phase)
            before, before_ns = phase, at_ns
        return None

    def finish(self) -> Sweep | None:
        """What is left when the packets have ended: the last sweep, mostly partial."""
        return self._close(None) if self._held else None

    def _close(self, stop_ns: int | None) -> Sweep:
        """The held packets as a sweep, from ``_start_ns`` to before ``stop_ns``, where the next one starts."""
        packets, self._held = self._held, []
        start_ns, self._start_ns = self._start_ns, stop_ns or 0
        base_ns = packets[0][0]
        pair, packet = self._time_pair, self._packet
        vector = self._vector(
            [packet(pair(at, at), data) for at, data in (((t - base_ns) * 1e-9, d) for t, d in packets)]
        )
        try:
            _, points = self._decoder.decode(vector, True)
        except RuntimeError as error:
            raise ReadError(
                "packets_damaged",
                f"{self._where}: {len(packets)} packets from {base_ns / 1e9:.3f} s on do not decode ({error}).",
                "Capture again; look at the network between sensor and recorder.",
            ) from error
        time = points["time"]
        keep = time > (start_ns - base_ns - _MARGIN_NS) * 1e-9
        if stop_ns is not None:
            keep &= time < (stop_ns - base_ns - _MARGIN_NS) * 1e-9
        if packets[0][1][-2] == DUAL or self._stream.decoding.model.product is None:
            strongest = (points["return_type"] & 1) != 0
            keep &= strongest | ~strongest.any()
        return self._sweep(start_ns, base_ns, points if keep.all() else points[keep])

    def _sweep(self, stamp_ns: int, base_ns: int, points: NDArray[np.void]) -> Sweep:
        offset: NDArray[np.int64] = np.zeros(len(points), np.int64)
        if not self._stamp_only:
            offset = np.rint(points["time"].astype(np.float64) * 1e9).astype(np.int64) + (base_ns - stamp_ns)
        # x, y, z are the first three floats of the 32 bytes of a point.
        xyz = np.ascontiguousarray(points).view(np.float32).reshape(-1, 8)[:, :3].copy()
        return Sweep(
            stamp_ns=stamp_ns,
            xyz=xyz,
            intensity=points["intensity"].copy(),
            ring=points["ring"].astype(np.uint16),
            offset_ns=offset,
            time_source="stamp_only" if self._stamp_only else "per_point",
        )

    def warnings(self) -> list[str]:
        """Sentences about what was met while reading."""
        told = (
            (self._lost, "packets were lost on the way (gaps in the sensor's own stamps)"),
            (self._damaged, "packets are not what this sensor sends and were left out"),
            (self._twins, "packets came twice and were taken once"),
            (self._disordered, "packets came after later ones and were left out"),
            (self._stalled, "times the sensor did not finish a turn in time; the sweep was cut all the same"),
            (self._clock.jumps, "times the sensor's clock and the host's were set against each other"),
        )
        return [f"{self._where}: {count} {what}." for count, what in told if count]
