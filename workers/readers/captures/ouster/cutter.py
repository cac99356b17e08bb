"""Sweeps from the packets of one Ouster sensor: cut where the sensor's own count of frames goes on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.readings import ReadOptions
from workers.readers.captures.ouster.metadata import OusterSensor
from workers.readers.captures.packet_clock import HOUR_US, PacketClock, learn_clock
from workers.readers.captures.packet_source import Packet, PacketStream, SweepCutter, packet_facts
from workers.readers.recording import ReadError, Sweep, TimeSource

_FRAMES: Final = 1 << 16
_LOST: Final = "packets were lost on the way (columns that no packet brought)"
_DUPLICATE: Final = "packets came twice and were taken once"
_OUT_OF_ORDER: Final = "packets came after those of the next turn and were left out"
_STRANGE: Final = "packets hold columns that the sensor does not have and were left out"


class OusterSource:
    """One sensor, known by its metadata; see :class:`workers.readers.captures.packet_source.PacketSource`."""

    maker = "Ouster"

    def __init__(self, sensor: OusterSensor) -> None:
        self._sensor = sensor

    def takes(self, payload: bytes) -> bool:
        """Whether a payload has the length of this sensor's packets, and its serial number where they hold one."""
        sensor = self._sensor
        if len(payload) != sensor.packet.itemsize:
            return False
        if sensor.serial_at is None or not sensor.serial:
            return True
        return int.from_bytes(payload[sensor.serial_at : sensor.serial_at + 5], "little") == sensor.serial

    def learn(self, sample: Sequence[Packet], options: ReadOptions, where: str) -> PacketStream:
        """Learn how the sensor's clock and the host's go together, and how fast it turns."""
        if not sample:
            raise ReadError("no_sweeps", f"{where} holds no packets.", "Record again, or choose another sensor.")
        sensor = self._sensor
        columns = np.frombuffer(b"".join(data for _, data in sample), sensor.packet)["columns"]
        moments = columns["t"].astype(np.int64)
        host_ns = np.array([at for at, _ in sample], np.int64)
        clock = learn_clock(host_ns, moments[:, 0] // 1000 % HOUR_US, where)
        step_ns = float(np.median(np.diff(moments, axis=1))) if moments.shape[1] > 1 else float(clock.packet_ns)
        sweep_ns = round(1e9 / options.rate_hz) if options.rate_hz else round(step_ns * sensor.columns)
        note = (
            f"{where}: an Ouster {sensor.title}, {len(sensor.ring)} rings; its own beam angles were taken, and "
            "points stand in its sensor frame (x away from the connector)."
        )
        facts = packet_facts(len(sensor.ring), sweep_ns, (note, clock.note), options)
        return PacketStream(
            sensor.title, facts, lambda: OusterCutter(sensor, clock.clock(), facts.time_source, where)
        )


class OusterCutter(SweepCutter):
    """The sweeps of one sensor, as :class:`workers.readers.captures.packet_source.SweepCutter` says."""

    def __init__(self, sensor: OusterSensor, clock: PacketClock, time_source: TimeSource, where: str) -> None:
        super().__init__(clock, time_source, where)
        self._sensor = sensor
        self._packets: list[Packet] = []
        self._numbers: set[int] = set()  # of the first columns of these packets
        self._frame = -1

    def add(self, host_ns: int, data: bytes) -> Sweep | None:
        """Take one packet; the sweep that it ends, where it does."""
        sensor = self._sensor
        first = np.frombuffer(data, sensor.packet)["columns"][0, 0]
        number, frame = int(first["number"]), int.from_bytes(data[sensor.frame_at : sensor.frame_at + 2], "little")
        if number >= sensor.columns:
            self._counts[_STRANGE] += 1
            return None
        ahead = (frame - self._frame) % _FRAMES if self._frame >= 0 else 0
        if ahead > _FRAMES // 2:
            self._counts[_OUT_OF_ORDER] += 1
            return None
        done = self.finish() if ahead else None
        if number in self._numbers:
            self._counts[_DUPLICATE] += 1
            return done
        self._frame = frame
        self._numbers.add(number)
        self._packets.append((self._clock.moment(host_ns, int(first["t"]) // 1000 % HOUR_US), data))
        return done

    def finish(self) -> Sweep | None:
        """Return the last sweep, mostly partial, when the packets have ended."""
        packets, self._packets = self._packets, []
        self._numbers.clear()
        return self._sweep(packets) if packets else None

    def _sweep(self, packets: Sequence[Packet]) -> Sweep:
        sensor = self._sensor
        columns = np.frombuffer(b"".join(data for _, data in packets), sensor.packet)["columns"]
        moment = np.array([at for at, _ in packets], np.int64)
        at_ns = (moment[:, None] + (columns["t"] - columns["t"][:, :1]).astype(np.int64)).reshape(-1)
        columns = columns.reshape(-1)
        self._counts[_LOST] += self._lost(columns["number"])
        usable = (columns["valid"] & 1 == 1) & (columns["number"] < sensor.columns)
        columns, at_ns = columns[usable], at_ns[usable]
        stamp_ns = int(moment.min())
        range_mm, reflectivity = pixel_values(sensor, columns["pixels"])
        column, row = np.nonzero(range_mm)  # in the order of time
        far = range_mm[column, row].astype(np.float32)[:, None]
        number = columns["number"][column]
        offset = at_ns[column] - stamp_ns if self._time_source == "per_point" else np.zeros(len(column), np.int64)
        return Sweep(
            stamp_ns=stamp_ns,
            xyz=(sensor.origin[row, number] + sensor.direction[row, number] * far).astype(np.float32, copy=False),
            intensity=reflectivity[column, row].astype(np.float32),
            ring=sensor.ring[row],
            offset_ns=offset,
            time_source=self._time_source,
        )

    def _lost(self, numbers: NDArray[np.uint16]) -> int:
        """Packets that are missing between the first and the last that came of this turn."""
        in_packet = self._sensor.packet["columns"].shape[0]
        firsts = np.sort(numbers[::in_packet].astype(int))
        return int(np.maximum(np.diff(firsts) // in_packet - 1, 0).sum())


def pixel_values(sensor: OusterSensor, pixels: NDArray[np.uint8]) -> tuple[NDArray[np.uint32], NDArray[np.uint8]]:
    """Range in millimetres, 0 where nothing came back, and reflectivity of pixels.

    Args:
        sensor: whose they are.
        pixels: (..., size) uint8.

    Returns:
        (...,) uint32 and (...,) uint8.
    """
    layout = sensor.pixel
    word = np.ascontiguousarray(pixels[..., :4]).view("<u4")[..., 0]
    range_mm = (word & np.uint32((1 << layout.range_bits) - 1)) * np.uint32(layout.unit_mm)
    return range_mm, pixels[..., layout.reflectivity]
