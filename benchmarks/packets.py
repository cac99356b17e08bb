"""What a VLP-16 sends over the network, captured as pcap.

Layout of the data packets: VLP-16 User Manual (63-9243 Rev. D), chapter 9. Twelve blocks of two firings of 16
lasers, ranges in steps of 2 mm, azimuth clockwise in hundredths of a degree, microseconds past the hour, and the
factory bytes 0x37 (strongest return) 0x22 (VLP-16).
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.simulation import SimulationOptions
from tests.workers.readers.making_packets import datagram, write_pcap
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
        self._lidar = lidar
        self._turn_s = 1.0 / lidar.sensor.rate_hz
        self._column_s = lidar.sensor.step_deg / 360.0 * self._turn_s
        self._begin_s = float(lidar.scan_seconds(np.zeros(())))  # from a sweep's start to when it looks ahead
        self._axis_z = -lidar.sensor.lens_m * np.tan(np.deg2rad(lidar.sensor.elevations_deg))
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
        leaves = self._axis_z[sweep.ring][:, None] * np.array([0.0, 0.0, 1.0])
        metres = np.linalg.norm(sweep.xyz - leaves, axis=1)
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
        turned = (at_s[::_FIRINGS] - self._begin_s) / self._turn_s
        clockwise = np.round(turned * 36_000.0).astype(np.int64) % 36_000
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


def packet_rig(options: SimulationOptions) -> SimulatedRig:
    """The rig of a VLP-16 whose packets are captured: decoders of these know where the beams leave the sensor."""
    return SimulatedRig(options, replace(SENSORS["vlp16"], lens_m=_LENS_M))


def write_capture(rig: SimulatedRig, path: Path) -> None:
    """Write the packets of a :func:`packet_rig`."""
    packets = Vlp16Packets(rig.lidar)
    write_pcap(path, ((at_ns, datagram(payload)) for sweep in rig.sweeps() for at_ns, payload in packets.of(sweep)))
