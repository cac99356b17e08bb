"""Each way of reading a file: one generator of the contents of all its messages."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

# The imports stand inside the functions, so that each way loads its own libraries alone.
Way = Callable[[Path], Iterator[bytes]]
_MCAP_RECORD_BYTES = 160 * 1024**2  # our own limit


def _container(bag: Any) -> Iterator[bytes]:
    for _, _, data in bag.messages([topic.name for topic in bag.topics]):
        yield data


def mcap_ours(path: Path) -> Iterator[bytes]:
    from workers.readers.ros.mcap_bag import McapBag

    yield from _container(McapBag(path))


def mcap_seeking(path: Path) -> Iterator[bytes]:
    """mcap, as its manual reads files."""
    from mcap.reader import make_reader

    with path.open("rb") as file:
        for _, _, message in make_reader(file, validate_crcs=True).iter_messages(log_time_order=False):
            yield message.data


def mcap_streaming(path: Path) -> Iterator[bytes]:
    """mcap from the beginning to the end, without the index, with a limit of a record's length."""
    from mcap.records import Message
    from mcap.stream_reader import StreamReader

    with path.open("rb") as file:
        for record in StreamReader(file, validate_crcs=True, record_size_limit=_MCAP_RECORD_BYTES).records:
            if isinstance(record, Message):
                yield record.data


def rosbags_rosbag2(path: Path) -> Iterator[bytes]:
    from rosbags.rosbag2 import Reader

    with Reader(path) as bag:
        for _, _, data in bag.messages():
            yield bytes(data)


def sqlite_ours(path: Path) -> Iterator[bytes]:
    from workers.readers.ros.sqlite_bag import SqliteBag

    yield from _container(SqliteBag(path))


def foxglove_ours(path: Path) -> Iterator[bytes]:
    from workers.readers.ros.mcap_bag import McapBag

    bag = McapBag(path)
    decoders: dict[str, Any] = {topic.name: bag.decoder(topic) for topic in bag.topics}
    for name, _, data in bag.messages([name for name, decode in decoders.items() if decode]):
        message = decoders[name](data)
        yield bytes(message.data) if hasattr(message, "data") else message.cloud.data.tobytes()


def foxglove_support(path: Path) -> Iterator[bytes]:
    """mcap-protobuf-support: classes made of the schema in the file."""
    from mcap.reader import make_reader
    from mcap_protobuf.decoder import DecoderFactory

    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for *_, message in reader.iter_decoded_messages(log_time_order=False):
            yield message.data


def pcap_ours(path: Path) -> Iterator[bytes]:
    from workers.readers.captures.capture import CaptureFile
    from workers.readers.captures.datagrams import Datagrams

    datagrams = Datagrams()
    for _, link, frame in CaptureFile(path).frames():
        datagram = datagrams.take(link, frame)
        if datagram is not None:
            yield datagram[3]


def pcap_dpkt(path: Path) -> Iterator[bytes]:
    from dpkt.ethernet import Ethernet
    from dpkt.pcap import UniversalReader
    from dpkt.udp import UDP

    with path.open("rb") as file:
        for _, frame in UniversalReader(file):
            datagram = getattr(Ethernet(frame).data, "data", None)
            if isinstance(datagram, UDP):
                yield bytes(datagram.data)


WAYS: dict[str, dict[str, Way]] = {
    "mcap": {
        "ours": mcap_ours,
        "by its index": mcap_seeking,
        "in a stream": mcap_streaming,
        "rosbags": rosbags_rosbag2,
    },
    "db3": {"ours": sqlite_ours, "rosbags": rosbags_rosbag2},
    "foxglove": {"ours": foxglove_ours, "mcap-protobuf-support": foxglove_support},
    "pcap": {"ours": pcap_ours, "dpkt": pcap_dpkt},
}
