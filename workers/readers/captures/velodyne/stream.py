"""Facts that hold for all packets of one Velodyne sensor: model, clock, rate, and where its turns are cut."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.readings import ReadOptions
from workers.readers.captures.packet_clock import HOUR_US, ClockFacts, learn_clock
from workers.readers.captures.packet_source import SAMPLE_PACKETS, Packet
from workers.readers.captures.velodyne.models import PACKET, Decoding, find_decoding
from workers.readers.recording import ReadError

TURN: Final = 36_000  # azimuth counts hundredths of a degree
_SWEEP_NS: Final = 100_000_000
_GAP_BINS: Final = 36
_MANY_TURNS: Final = 20


@dataclass(frozen=True, slots=True)
class TurnFacts:
    """Facts that hold for the turns of one sensor.

    Attributes:
        decoding: its model and how it is decoded.
        clock: the relation of its stamps to the host's.
        seam: azimuth at which sweeps are cut, hundredths of a degree.
        sweep_ns: duration of a turn.
        notes: sentences about what was found and assumed.
    """

    decoding: Decoding
    clock: ClockFacts
    seam: int
    sweep_ns: int
    notes: Sequence[str]


def learn_turns(sample: Sequence[Packet], options: ReadOptions, where: str) -> TurnFacts:
    """Learn from the first packets of a sensor how all of them become sweeps, as :class:`PacketSource` says."""
    if not sample:
        raise ReadError("no_sweeps", f"{where} holds no packets.", "Record again, or choose another sensor.")
    decoding = find_decoding([data for _, data in sample], options.lidar_model, where)
    rows = np.array([PACKET.unpack(data) for _, data in sample], np.int64)
    azimuth = rows[:, 1:24:2] % TURN
    clock = learn_clock(np.array([stamp for stamp, _ in sample], np.int64), rows[:, 24], where)
    # By the clock and not by the count of packets: a sensor that is set to a sector is silent outside of it.
    sweep_ns = _sweep_duration(azimuth, clock.elapsed_ns, options)
    seam, cut = _seam(azimuth)
    cut_note = f"{where}: sweeps are cut at azimuth {seam / 100:.2f} degrees, {cut}; stamps are their starts."
    return TurnFacts(decoding, clock, seam, sweep_ns, [*decoding.notes, clock.note, cut_note])


def evened(last_ns: int, payloads: Sequence[bytes]) -> list[Packet]:
    """Return packets that came together and have one stamp, the last one's; the sensor's clock spaces the others."""
    device_us = [PACKET.unpack(data)[24] for data in payloads]
    return [
        (last_ns - (device_us[-1] - at) % HOUR_US * 1000, data) for at, data in zip(device_us, payloads, strict=True)
    ]


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
    """Return the azimuth at which sweeps are cut, and a note.

    It lies in the middle of the field that the sensor does not send, else behind it, where vehicles and people stand
    least. A short recording is cut where it begins, so that its first turn is whole.
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
