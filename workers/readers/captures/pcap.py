"""Network captures (pcap, pcapng) of LiDARs' packets: every sensor in them a LiDAR."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from apexcal.documents.readings import ReadOptions
from workers.readers.captures.capture import CaptureFile
from workers.readers.captures.datagrams import KNOWN_LINKS, Datagrams, endpoint
from workers.readers.captures.other_makers import instead, maker_of_datagram
from workers.readers.captures.ouster.cutter import OusterSource
from workers.readers.captures.ouster.metadata import read_metadata
from workers.readers.captures.packet_source import (
    FIELDS,
    SAMPLE_PACKETS,
    Packet,
    PacketSource,
    PacketStream,
    SweepCutter,
)
from workers.readers.captures.velodyne.cutter import VelodyneSource
from workers.readers.omissions import Omissions
from workers.readers.recording import Frame, LidarFacts, ReadError, Recording, Sensor, Sweep

_SAMPLE_BYTES: Final = 24_000_000
_FEW: Final = 20

# A sensor on the network: (its address, the port it sends to)
_Key = tuple[bytes, int]


@dataclass(slots=True)
class _Overview:
    """The beginning of a capture; for each sender that is a sensor, its maker and its first packets."""

    sources: dict[_Key, PacketSource] = field(default_factory=dict[_Key, PacketSource])
    packets: dict[_Key, list[Packet]] = field(default_factory=dict[_Key, list[Packet]])
    others: Counter[tuple[bytes, int, int]] = field(default_factory=Counter[tuple[bytes, int, int]])
    links: set[int] = field(default_factory=set[int])
    makers: Counter[str] = field(default_factory=Counter[str])
    frames: int = 0


class PcapRecording(Recording):
    """A capture of what LiDARs send; each sender and port is one LiDAR, named ``address:port``.

    Args:
        path: the capture.
        options: what the owner knows.
        metadata: by their paths, the documents beside it in which Ouster sensors say what they are.

    Raises:
        ReadError: ``capture_damaged``, ``no_lidar_packets``, ``lidar_packets_not_read``,
            ``lidar_metadata_unusable``, and what the makers' sources raise.
    """

    format = "pcap"

    def __init__(self, path: Path, options: ReadOptions, metadata: Mapping[str, bytes] | None = None) -> None:
        self._path = path
        self._sources: list[PacketSource] = [
            VelodyneSource(),
            *(OusterSource(read_metadata(data, name)) for name, data in (metadata or {}).items()),
        ]
        self._capture = CaptureFile(path)
        self._cutters: dict[str, SweepCutter] = {}
        self._strangers: Counter[str] = Counter()
        self._fragments = 0
        overview = self._look()
        if not overview.packets:
            raise self._nothing(overview)
        self._keys = {key: endpoint(*key) for key in overview.packets}
        self._of_sender = overview.sources
        self._streams: dict[str, PacketStream] = {
            self._keys[key]: self._of_sender[key].learn(sample, options, self._keys[key])
            for key, sample in overview.packets.items()
        }
        self.sensors = [
            Sensor(
                *("lidar", name, "", None),
                {"fields": FIELDS, "model": stream.title, "rate_hz": f"{1e9 / stream.facts.sweep_ns:.3g}"},
            )
            for name, stream in self._streams.items()
        ]
        self.other_topics = [
            f"UDP {endpoint(sender, port)} ({size} bytes)" for sender, port, size in sorted(overview.others)[:_FEW]
        ]

    def _look(self) -> _Overview:
        """Read the beginning of the file."""
        overview = _Overview()
        datagrams = Datagrams()
        for host_ns, link, frame in self._capture.frames():
            overview.frames += 1
            overview.links.add(link)
            datagram = datagrams.take(link, frame)
            if datagram is None:
                continue
            sender, _, port, payload = datagram
            source = overview.sources.get((sender, port)) or self._source(payload)
            if source is not None and source.takes(payload):
                overview.sources[sender, port] = source
                sample = overview.packets.setdefault((sender, port), [])
                if len(sample) < SAMPLE_PACKETS:
                    sample.append((host_ns, payload))
                elif all(len(sample) >= SAMPLE_PACKETS for sample in overview.packets.values()):
                    break
            elif len(overview.others) < 1000:
                overview.others[sender, port, len(payload)] += 1
                maker = maker_of_datagram(payload, port)
                if maker is not None:
                    overview.makers[maker] += 1
            if self._capture.position > _SAMPLE_BYTES and overview.packets:
                break
        return overview

    def _source(self, payload: bytes) -> PacketSource | None:
        return next((source for source in self._sources if source.takes(payload)), None)

    def _nothing(self, overview: _Overview) -> ReadError:
        if not overview.frames:
            return ReadError(
                "recording_empty",
                f"{self._path.name} is a capture without packets.",
                "Capture again, or look at it.",
            )
        if self._capture.snapped:
            return ReadError(
                "capture_cut",
                f"{self._path.name} holds no whole packet of a LiDAR. {self._capture.snap_sentence}",
                "A LiDAR's packets have 1248 bytes and more, with their headers.",
            )
        unknown = sorted(overview.links - KNOWN_LINKS)
        if unknown:
            return ReadError(
                "capture_link_unsupported",
                f"{self._path.name} was captured on a link of type {unknown[0]}, which is not read.",
                "Capture on the Ethernet interface to which the sensor is connected.",
            )
        listed = ", ".join(
            f"{count} of {size} bytes from {endpoint(sender, port)}"
            for (sender, port, size), count in overview.others.most_common(5)
        )
        if overview.makers:
            makers = sorted(overview.makers)
            return ReadError(
                "lidar_packets_not_read",
                f"{self._path.name} holds packets of a LiDAR by {' and '.join(makers)} that cannot be read: "
                f"{listed}.",
                instead(makers),
            )
        return ReadError(
            "no_lidar_packets",
            f"{self._path.name} holds no packets of a LiDAR that is read among {overview.frames}"
            + (f"; its datagrams: {listed}." if listed else " and no whole UDP datagram."),
            "Captures of Velodyne sensors are read (UDP, 1206 bytes a packet, port 2368 unless set otherwise), and "
            "those of Ouster sensors together with their metadata (.json). For another maker's sensor, record its "
            "driver's point cloud.",
        )

    @property
    def share_read(self) -> float:
        """Share of the file that has been read."""
        return min(1.0, self._capture.position / max(1, self._capture.size))

    @property
    def omissions(self) -> Omissions:
        """None: packets are left out one by one, not sweeps."""
        return Omissions()

    @property
    def warnings(self) -> list[str]:
        """Sentences about what was met while reading."""
        sentences = [sentence for cutter in self._cutters.values() for sentence in cutter.warnings()]
        if self._capture.cut_short:
            sentences.append(self._capture.cut_short)
        if self._capture.snapped:
            sentences.append(self._capture.snap_sentence)
        if self._capture.untimed:
            sentences.append(f"{self._capture.untimed} packets have no usable time stamp and were left out.")
        if self._fragments:
            sentences.append(f"{self._fragments} fragments of incomplete datagrams were left out.")
        sentences.extend(
            f"{count} packets of another sensor, {name}, which was silent at first, were left out."
            for name, count in self._strangers.items()
        )
        return sentences

    def lidar_facts(self, sensor: Sensor) -> LidarFacts:
        """The facts learned from the beginning of the capture."""
        return self._streams[sensor.name].facts

    def messages(self, sensors: Sequence[Sensor]) -> Iterator[tuple[Sensor, Sweep | Frame]]:
        """All chosen sensors in one pass, each sweep when it is whole."""
        chosen = {sensor.name: sensor for sensor in sensors}
        cutters: dict[str, SweepCutter] = {name: self._streams[name].cutter() for name in chosen}
        self._cutters |= cutters
        self._strangers.clear()
        by_sender = {
            key: (chosen[name], self._of_sender[key].takes, cutters[name])
            for key, name in self._keys.items()
            if name in chosen
        }
        datagrams = Datagrams()
        for host_ns, link, frame in self._capture.frames():
            datagram = datagrams.take(link, frame)
            if datagram is None:
                continue
            sender, _, port, payload = datagram
            of_sender = by_sender.get((sender, port))
            if of_sender is None:
                is_silent_at_first = (sender, port) not in self._keys and len(self._strangers) < _FEW
                if is_silent_at_first and self._source(payload) is not None:
                    self._strangers[endpoint(sender, port)] += 1
                continue
            sensor, takes, cutter = of_sender
            if not takes(payload):
                continue
            sweep = cutter.add(host_ns, payload)
            if sweep is not None:
                yield sensor, sweep
        self._fragments = datagrams.fragments
        for sensor, _, cutter in by_sender.values():
            sweep = cutter.finish()
            if sweep is not None:
                yield sensor, sweep
