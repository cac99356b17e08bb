"""The files that are read: a simulated walk in each container, damaged ones and bombs."""

from __future__ import annotations

import random
import struct
import sys
from collections.abc import Iterator
from pathlib import Path

import zstandard
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from mcap_protobuf.writer import Writer as ProtobufWriter

from apexcal.documents.simulation import SimulationOptions
from benchmarks.readers.packets import packet_rig, write_capture
from workers.readers.detect import open_recording
from workers.readers.recording import Sweep
from workers.simulation.simulate import simulate

_NOISE_BYTES = 16
_HUGE = 1 << 62
_BOMB_BYTES = 2 * 1024**3
_MAGIC = b"\x89MCAP0\r\n"
_TESTS = Path(__file__).parents[2] / "tests" / "workers" / "readers"


def whole(folder: Path, seconds: float) -> dict[str, Path]:
    """A walk of so many seconds in each container, by the container's name."""
    files: dict[str, Path] = {}
    for name in ("mcap", "db3"):
        simulate(SimulationOptions(seconds=seconds, seed=7, format=name), folder / name)
        (files[name],) = (folder / name).rglob(f"*.{name}")
    files["pcap"] = folder / "lidar.pcap"
    write_capture(packet_rig(SimulationOptions(seconds=seconds, seed=7)), files["pcap"])
    files["foxglove"] = _foxglove(files["mcap"], folder / "foxglove.mcap")
    return files


def _foxglove(source: Path, path: Path) -> Path:
    recording = open_recording(source)
    with path.open("wb") as file, ProtobufWriter(file) as writer:
        for sensor, item in recording.messages(recording.sensors):
            if isinstance(item, Sweep):
                fields = [PackedElementField(name=n, offset=4 * i, type=7) for i, n in enumerate("xyz")]
                message = PointCloud(frame_id="lidar", point_stride=12, fields=fields, data=item.xyz.tobytes())
            else:
                message = CompressedImage(frame_id=sensor.name, format="jpeg", data=item.data)
            message.timestamp.FromNanoseconds(item.stamp_ns)
            writer.write_message(sensor.name, message, item.stamp_ns, item.stamp_ns)
    recording.close()
    return path


def damaged(path: Path, folder: Path, count: int) -> Iterator[tuple[str, Path]]:
    """("cut" or "noise", file): the file cut short, and with 16 bytes made noise, at random places."""
    data = path.read_bytes()
    chance = random.Random(0)
    target = folder / f"damaged{path.suffix}"
    for _ in range(count):
        target.write_bytes(data[: chance.randrange(len(data) // 20, len(data))])
        yield "cut", target
        place = chance.randrange(len(data) - _NOISE_BYTES)
        target.write_bytes(data[:place] + chance.randbytes(_NOISE_BYTES) + data[place + _NOISE_BYTES :])
        yield "noise", target


def bombs(files: dict[str, Path], folder: Path) -> Iterator[tuple[str, str, Path]]:
    """(container, what is wrong, file) of small files that claim to be huge, or are."""
    header = struct.pack("<BQ", 1, 8) + bytes(8)
    packed = zstandard.ZstdCompressor(level=1).compress(bytes(_BOMB_BYTES))
    for what, claim in (("2 GiB in a chunk of zeros", _BOMB_BYTES), ("2 GiB in a chunk that claims 1 kB", 1000)):
        chunk = struct.pack("<QQQII", 0, 1, claim, 0, 4) + b"zstd" + struct.pack("<Q", len(packed)) + packed
        yield "mcap", what, _write(folder / "chunk.mcap", _MAGIC + header + struct.pack("<BQ", 6, len(chunk)) + chunk)
    record = _MAGIC + header + struct.pack("<BQ", 5, _HUGE) + bytes(100)
    yield "mcap", "a record that claims 4 EiB", _write(folder / "record.mcap", record)
    pcap = files["pcap"].read_bytes()[: 1 << 20]
    packet = pcap[:32] + struct.pack("<II", 0xFFFFFFFF, 0xFFFFFFFF) + pcap[40:]
    yield "pcap", "a packet that claims 4 GiB", _write(folder / "packet.pcap", packet)
    sys.path.insert(0, str(_TESTS))  # the tests have bombs of SQLite
    from making_bombs import BOMBS

    for name in ("endless_view", "endless_messages", "generated_column", "default_column", "endless_tree"):
        yield "db3", name, BOMBS[name](folder / f"{name}.db3")
    yield "foxglove", "a message of 20 million empty fields", _fields(folder / "fields.mcap")


def _write(path: Path, data: bytes) -> Path:
    path.write_bytes(data)
    return path


def _fields(path: Path) -> Path:
    # Field 5 of foxglove.PointCloud is a message, here an empty one: two bytes that become an object each.
    with path.open("wb") as file, ProtobufWriter(file) as writer:
        writer.write_message("lidar", PointCloud(), 0, 0)
        (channel,) = writer._channels.values()
        writer._writer.add_message(channel, 0, b"\x2a\x00" * 20_000_000, 0)
    return path
