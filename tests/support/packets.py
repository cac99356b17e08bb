"""What a VLP-16 sends over the network, captured as pcap; for tests and benchmarks.

Layout of the data packets: VLP-16 User Manual (63-9243 Rev. D), chapter 9. Twelve blocks of two firings of 16
lasers, ranges in steps of 2 mm, azimuth clockwise in hundredths of a degree, microseconds past the hour, and the
factory bytes 0x37 (strongest return) 0x22 (VLP-16).
"""

from __future__ import annotations

import math
import struct
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.simulation import SimulationOptions
from workers.readers.recording import Sweep
from workers.simulation.lidar import SimulatedLidar
from workers.simulation.rig import SimulatedRig
from workers.simulation.sensors import SENSORS

_FIRINGS = 2  # columns per block
_BLOCKS = 12
_LASERS = 16
_RANGE_STEP_M = 0.002
_HOUR_US = 3_600_000_000
# Of a VLP-16: the "vertical correction" of its manual, 11.2 mm at -15 degrees.
_LENS_M = 0.0419
_TO_HOST_NS = 150_000  # from the last firing of a packet to the recorder

_CHANNEL = np.dtype([("range", "<u2"), ("reflectivity", "u1")])
_BLOCK = np.dtype([("flag", "<u2"), ("azimuth", "<u2"), ("channels", _CHANNEL, _FIRINGS * _LASERS)])
_PACKET = np.dtype([("blocks", _BLOCK, _BLOCKS), ("time_us", "<u4"), ("mode", "u1"), ("product", "u1")])


class Vlp16Packets:
    """Turns sweeps into the data packets that the sensor would have sent.

    A sensor that is set to a sector sends nothing outside of it; its last packet is filled up with firings that met
    nothing, so that no packet spans the gap.
    """

    def __init__(self, lidar: SimulatedLidar) -> None:
        if len(lidar.firing) != _LASERS:
            raise ValueError(f"a VLP-16 has {_LASERS} lasers, not {len(lidar.firing)}")
        self._lidar = lidar
        self._column_s = lidar.seconds_per_column()
        per_packet = _BLOCKS * _FIRINGS
        self._packets = -(-lidar.columns // per_packet)
        self._columns = self._packets * per_packet
        self._length_ns = round(per_packet * self._column_s * 1e9)

    def of(self, sweep: Sweep) -> list[tuple[int, bytes]]:
        """When the host gets each packet (UTC nanoseconds), and its 1206 bytes."""
        fired_s = sweep.offset_ns * 1e-9 - self._lidar.delay_s[sweep.ring]
        nearest = float(fired_s.min()) if fired_s.size else 0.0
        phase_s = nearest - math.floor(nearest / self._column_s + 1e-6) * self._column_s
        column: NDArray[np.int64] = np.round((fired_s - phase_s) / self._column_s).astype(np.int64)
        ranges = np.zeros((self._columns, _LASERS), np.uint16)
        reflectivity = np.zeros((self._columns, _LASERS), np.uint8)
        laser = self._lidar.firing[sweep.ring]
        metres = np.linalg.norm(sweep.xyz - self._lidar.leaves(sweep.ring), axis=1)
        ranges[column, laser] = np.round(metres / _RANGE_STEP_M)
        reflectivity[column, laser] = np.clip(np.round(sweep.intensity), 0.0, 255.0)
        at_s = phase_s + np.arange(self._columns, dtype=np.float64) * self._column_s
        return self._packed(sweep.stamp_ns, at_s, ranges, reflectivity)

    def _packed(
        self,
        stamp_ns: int,
        at_s: NDArray[np.float64],
        ranges: NDArray[np.uint16],
        reflectivity: NDArray[np.uint8],
    ) -> list[tuple[int, bytes]]:
        packets = np.zeros(self._packets, _PACKET)
        clockwise = np.round(np.degrees(-self._lidar.azimuth(at_s[::_FIRINGS])) * 100.0).astype(np.int64) % 36_000
        shape = (self._packets, _BLOCKS, _FIRINGS * _LASERS)
        packets["blocks"]["flag"] = 0xEEFF  # the bytes FF EE
        packets["blocks"]["azimuth"] = clockwise.reshape(self._packets, _BLOCKS)
        packets["blocks"]["channels"]["range"] = ranges.reshape(shape)
        packets["blocks"]["channels"]["reflectivity"] = reflectivity.reshape(shape)
        begins = stamp_ns + np.round(at_s[:: _BLOCKS * _FIRINGS] * 1e9).astype(np.int64)
        packets["time_us"] = (begins + 500) // 1000 % _HOUR_US
        packets["mode"], packets["product"] = 0x37, 0x22
        received = (begins + self._length_ns + _TO_HOST_NS).tolist()
        return [(at, packet.tobytes()) for at, packet in zip(received, packets, strict=True)]


class Pcap:
    """A capture of network packets that grows, in the classic format with microseconds.

    Raises FileExistsError where the file is there already.
    """

    def __init__(self, path: Path) -> None:
        self._file: BinaryIO = path.open("xb")
        self._file.write(struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1))

    def add(self, at_ns: int, frame: bytes) -> None:
        """An Ethernet frame and when the host got it."""
        seconds, rest = divmod(at_ns, 1_000_000_000)
        self._file.write(struct.pack("<IIII", seconds, rest // 1000, len(frame), len(frame)) + frame)

    def close(self) -> None:
        """The file is complete."""
        self._file.close()


def ethernet(payload: bytes, port: int = 2368) -> bytes:
    """An Ethernet frame with a UDP datagram broadcast by the sensor's factory address."""
    udp = struct.pack(">HHHH", port, port, 8 + len(payload), 0) + payload
    address = bytes((192, 168, 1, 201)) + bytes((255, 255, 255, 255))
    head = struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(udp), 0, 0x4000, 128, 17, 0)
    total = sum(struct.unpack(">10H", head + address))
    total = (total & 0xFFFF) + (total >> 16)
    checksum = struct.pack(">H", ~(total + (total >> 16)) & 0xFFFF)
    return b"\xff" * 6 + bytes.fromhex("607688000000") + b"\x08\x00" + head[:10] + checksum + address + udp


def packet_rig(options: SimulationOptions) -> SimulatedRig:
    """The rig of a VLP-16 whose packets are captured: decoders of these know where the beams leave the sensor."""
    return SimulatedRig(options, replace(SENSORS["vlp16"], lens_m=_LENS_M))


def write_capture(rig: SimulatedRig, path: Path) -> None:
    """Write the packets of all sweeps of a :func:`packet_rig`. Raises FileExistsError where the file is there."""
    packets, capture = Vlp16Packets(rig.lidar), Pcap(path)
    for sweep in rig.sweeps():
        for at_ns, payload in packets.of(sweep):
            capture.add(at_ns, ethernet(payload))
    capture.close()
