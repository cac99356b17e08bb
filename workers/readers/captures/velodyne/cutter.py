"""Sweeps from the packets of one Velodyne sensor: cut at the seam, decoded by velodyne-decoder.

A sweep is one turn from seam to seam, to the laser: a packet across the seam is decoded twice and each half kept
once, so that no point is in two sweeps and none is lost.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.readings import ReadOptions
from workers.readers.captures.packet_source import Packet, PacketStream, SweepCutter, packet_facts
from workers.readers.captures.velodyne.models import BLOCKS, DUAL, PACKET, is_data_packet
from workers.readers.captures.velodyne.stream import TURN, TurnFacts, learn_turns
from workers.readers.recording import ReadError, Sweep, TimeSource

_BACK: Final = 1_000
# Less than the time from one laser to the next, 1.2 us at least, and more than float32 seconds lose.
_MARGIN_NS: Final = 200
# Hundredths of a degree from one block to the next; at 20 Hz a sensor turns by 0.8 degrees.
_JUMP: Final = 500
_LOST: Final = "packets were lost on the way (gaps in the sensor's own stamps)"
_MALFORMED: Final = "packets are not what this sensor sends and were left out"
_DUPLICATE: Final = "packets came twice and were taken once"
_OUT_OF_ORDER: Final = "packets came after later ones and were left out"
_SPLIT: Final = "packets span the end of the field of view: their second part was not read"
_UNFINISHED: Final = "times the sensor did not finish a turn in time; the sweep was cut all the same"


class VelodyneCutter(SweepCutter):
    """The sweeps of one sensor, as :class:`workers.readers.captures.packet_source.SweepCutter` says."""

    def __init__(self, stream: TurnFacts, time_source: TimeSource, where: str) -> None:
        super().__init__(stream.clock.clock(), time_source, where)
        velodyne: Any = import_module("velodyne_decoder")
        library: Any = import_module("velodyne_decoder.velodyne_decoder_pylib")
        self._time_pair: Any = library.TimePair
        self._packet: Any = velodyne.VelodynePacket
        self._vector: Any = velodyne.PacketVector
        self._decoder: Any = velodyne.ScanDecoder(stream.decoding.config)
        self._stream = stream
        self._usual = (0xEEFF,) * BLOCKS  # of most sensors, told faster than by the set
        self._held: list[Packet] = []
        self._lead: Packet | None = None  # the packet before the held ones
        self._start_ns = 0
        self._phase = -1  # azimuth from the seam, and moment, of the last firing cycle
        self._cycle_at = 0
        self._last_data = b""

    def add(self, host_ns: int, data: bytes) -> Sweep | None:
        """Take one packet; the sweep that it ends, where it does."""
        fields = PACKET.unpack(data)
        stream, model = self._stream, self._stream.decoding.model
        azimuths = fields[1:24:2]
        highest = max(azimuths)
        if stream.decoding.patch:
            data = data[:-2] + stream.decoding.patch
        flags = fields[:24:2]
        if (
            (flags != self._usual and not model.flags.issuperset(flags))
            or highest >= TURN
            or (model.product is not None and data[-1] != model.product)
        ):
            self._counts[_MALFORMED] += 1
            return None
        if data == self._last_data:
            self._counts[_DUPLICATE] += 1
            return None
        moment = self._clock.moment(host_ns, fields[24])
        phases = [(azimuth - stream.seam) % TURN for azimuth in azimuths]
        gap_ns = moment - self._held[-1][0] if self._held else 0
        if gap_ns < 0:
            self._counts[_OUT_OF_ORDER] += 1
            return None
        self._last_data = data
        if highest - min(azimuths) > _JUMP:
            steps = [(after - before) % TURN for before, after in pairwise(azimuths)]
            jump = next((k for k, step in enumerate(steps, start=1) if _JUMP < step < TURN - _JUMP), None)
            if jump is not None:
                data, phases = self._before(jump, data, phases)
        return self._cut(moment, data, phases, gap_ns)

    def _before(self, jump: int, data: bytes, phases: list[int]) -> tuple[bytes, list[int]]:
        """The packet without its blocks from ``jump`` on, which a sensor that is set to a sector fires after the gap.

        The decoder would spread the gap over all blocks of the packet, and its stamp is that of the blocks before.
        """
        self._counts[_SPLIT] += 1
        width = self._width(data)
        step = TURN * self._stream.clock.packet_ns * width / (self._stream.sweep_ns * BLOCKS)
        last = phases[jump - 1]
        even = [round(last + (k // width - (jump - 1) // width) * step) for k in range(jump, BLOCKS)]
        blocks = [data[100 * k : 100 * k + 100] for k in range(BLOCKS)]
        for k, phase in zip(range(jump, BLOCKS), even, strict=True):
            azimuth = (phase + self._stream.seam) % TURN
            blocks[k] = blocks[k][:2] + azimuth.to_bytes(2, "little") + bytes(96)
        return b"".join(blocks) + data[1200:], [*phases[:jump], *(phase % TURN for phase in even)]

    def _width(self, data: bytes) -> int:
        """Blocks of one firing of all lasers."""
        model = self._stream.decoding.model
        # An HDL-64E shows dual return by sending an azimuth twice.
        dual = data[2:4] == data[202:204] if model.product is None else data[-2] == DUAL
        return model.blocks * (1 + dual)

    def _cut(self, moment: int, data: bytes, phases: list[int], gap_ns: int) -> Sweep | None:
        """Hold a packet, and close the sweep where it crosses the seam or comes too late to belong to it."""
        stream = self._stream
        if gap_ns > 1.5 * stream.clock.packet_ns and phases[0] > self._phase:
            self._counts[_LOST] += round(gap_ns / stream.clock.packet_ns) - 1
        if not self._held:
            self._start_ns = moment - stream.decoding.model.early_ns
        crossing = None
        stalled = bool(self._held) and moment - self._start_ns > 2.5 * stream.sweep_ns
        if self._held and (gap_ns > 0.75 * stream.sweep_ns or stalled):
            self._counts[_UNFINISHED] += stalled
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
        width = self._width(data)
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
                return before_ns + (at_ns - before_ns) * (TURN - before) // (TURN - before + phase)
            before, before_ns = phase, at_ns
        return None

    def finish(self) -> Sweep | None:
        """Return the last sweep, mostly partial, when the packets have ended."""
        return self._close(None) if self._held else None

    def _close(self, stop_ns: int | None) -> Sweep:
        """The held packets as a sweep, from ``_start_ns`` to before ``stop_ns``, where the next one starts."""
        packets, self._held = self._held, []
        start_ns, self._start_ns = self._start_ns, stop_ns or 0
        lead, self._lead = self._lead, packets[-2] if len(packets) > 1 else None
        # At the first packet that it is given, the decoder does not know yet how fast the sensor turns: a VLS-128's
        # azimuths would be off by up to 0.16 degrees.
        if lead is None or packets[0][0] - lead[0] >= 1.5 * self._stream.clock.packet_ns:
            lead = self._led(packets)
        if lead is not None:
            packets = [lead, *packets]
        base_ns = packets[0][0]
        pair, packet = self._time_pair, self._packet
        vector = self._vector(
            # A list of numbers is taken faster than bytes.
            [packet(pair(at, at), list(data)) for at, data in (((t - base_ns) * 1e-9, d) for t, d in packets)]
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
        # Of most packets, because one may be damaged.
        dual = 2 * sum(data[-2] == DUAL for _, data in packets) > len(packets)
        if dual or self._stream.decoding.model.product is None:
            strongest = (points["return_type"] & 1) != 0
            keep &= strongest | ~strongest.any()
        return self._sweep(start_ns, base_ns, _kept(points, keep))

    def _led(self, packets: list[Packet]) -> Packet | None:
        """A packet without returns before the first one, as fast as the next one comes; None where that is far."""
        if len(packets) < 2 or packets[1][0] - packets[0][0] >= 1.5 * self._stream.clock.packet_ns:
            return None
        (first_ns, first), (next_ns, following) = packets[:2]
        turned = int.from_bytes(following[2:4], "little") - int.from_bytes(first[2:4], "little")
        blocks = b"".join(
            first[at : at + 2]
            + ((int.from_bytes(first[at + 2 : at + 4], "little") - turned) % TURN).to_bytes(2, "little")
            + bytes(96)
            for at in range(0, 100 * BLOCKS, 100)
        )
        return 2 * first_ns - next_ns, blocks + first[1200:]

    def _sweep(self, stamp_ns: int, base_ns: int, points: NDArray[np.void]) -> Sweep:
        offset: NDArray[np.int64] = np.zeros(len(points), np.int64)
        if self._time_source == "per_point":
            offset = np.rint(points["time"].astype(np.float64) * 1e9).astype(np.int64) + (base_ns - stamp_ns)
        # x, y, z are the first three floats of the 32 bytes of a point.
        coordinates = np.ascontiguousarray(points).view(np.float32).reshape(-1, 8)
        xyz = np.empty((len(points), 3), np.float32)
        for axis in range(3):  # a quarter of the time of one copy of all three
            xyz[:, axis] = coordinates[:, axis]
        return Sweep(
            stamp_ns=stamp_ns,
            xyz=xyz,
            intensity=points["intensity"].copy(),
            ring=points["ring"].astype(np.uint16),
            offset_ns=offset,
            time_source=self._time_source,
        )


class VelodyneSource:
    """All of Velodyne's sensors; see :class:`workers.readers.captures.packet_source.PacketSource`."""

    maker = "Velodyne"

    def takes(self, payload: bytes) -> bool:
        """Whether a payload looks like the measurements of a Velodyne sensor."""
        return is_data_packet(payload)

    def learn(self, sample: Sequence[Packet], options: ReadOptions, where: str) -> PacketStream:
        """Learn from the first packets of a sensor how all of them become sweeps."""
        turns = learn_turns(sample, options, where)
        model = turns.decoding.model
        facts = packet_facts(model.rings, turns.sweep_ns, turns.notes, options)
        return PacketStream(model.title, facts, lambda: VelodyneCutter(turns, facts.time_source, where))


def _kept(points: NDArray[np.void], keep: NDArray[np.bool_]) -> NDArray[np.void]:
    """Points where ``keep``; a view where these follow one another, as they do unless a second return is dropped."""
    if keep.all() or not keep.any():
        return points if len(points) and keep[0] else points[:0]
    first, last = int(keep.argmax()), len(keep) - int(keep[::-1].argmax())
    return points[first:last] if keep[first:last].all() else points[keep]
