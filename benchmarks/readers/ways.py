"""Each way of reading a file: one generator of (topic or sender, content) of all its messages."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

# The imports stand inside the functions: what each of them costs is one of the figures.
Message = tuple[str, bytes]
Way = Callable[[Path], Iterator[Message]]
_MCAP_RECORD_BYTES = 160 * 1024**2  # our own limit


def mcap_ours(path: Path) -> Iterator[Message]:
    from workers.readers.ros.mcap_bag import McapBag

    bag = McapBag(path)
    for name, _, data in bag.messages([topic.name for topic in bag.topics]):
        yield name, data


def mcap_seeking(path: Path) -> Iterator[Message]:
    """mcap, as its manual reads files."""
    from mcap.reader import make_reader

    with path.open("rb") as file:
        for _, channel, message in make_reader(file, validate_crcs=True).iter_messages(log_time_order=False):
            yield channel.topic, message.data


def mcap_streaming(path: Path) -> Iterator[Message]:
    """mcap from the beginning to the end, without the index, with a limit of a record's length."""
    from mcap.records import Channel, Message
    from mcap.stream_reader import StreamReader

    topics: dict[int, str] = {}
    with path.open("rb") as file:
        for record in StreamReader(file, validate_crcs=True, record_size_limit=_MCAP_RECORD_BYTES).records:
            if isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, Message):
                yield topics[record.channel_id], record.data


def rosbags_rosbag2(path: Path) -> Iterator[Message]:
    from rosbags.rosbag2 import Reader

    with Reader(path) as bag:
        for connection, _, data in bag.messages():
            yield connection.topic, bytes(data)


def sqlite_ours(path: Path) -> Iterator[Message]:
    from workers.readers.ros.sqlite_bag import SqliteBag

    bag = SqliteBag(path)
    for name, _, data in bag.messages([topic.name for topic in bag.topics]):
        yield name, data


def foxglove_ours(path: Path) -> Iterator[Message]:
    from workers.readers.ros.mcap_bag import McapBag

    bag = McapBag(path)
    decoders = {topic.name: bag.decoder(topic) for topic in bag.topics}
    for name, _, data in bag.messages(list(decoders)):
        decode = decoders[name]
        if decode is not None:
            message = decode(data)
            yield name, bytes(message.data) if hasattr(message, "data") else message.cloud.data.tobytes()


def foxglove_support(path: Path) -> Iterator[Message]:
    """mcap-protobuf-support: classes made of the schema in the file."""
    from mcap.reader import make_reader
    from mcap_protobuf.decoder import DecoderFactory

    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, _, message in reader.iter_decoded_messages(log_time_order=False):
            yield channel.topic, message.data


def pcap_ours(path: Path) -> Iterator[Message]:
    from workers.readers.captures.capture import Capture
    from workers.readers.captures.datagrams import Datagrams, endpoint

    datagrams = Datagrams()
    for _, link, frame in Capture(path).frames():
        datagram = datagrams.take(link, frame)
        if datagram is not None:
            yield endpoint(datagram[0], datagram[2]), datagram[3]


def pcap_container_ours(path: Path) -> Iterator[Message]:
    """Frames alone, without taking datagrams out of them."""
    from workers.readers.captures.capture import Capture

    for _, link, frame in Capture(path).frames():
        yield str(link), frame


def pcap_container_dpkt(path: Path) -> Iterator[Message]:
    from dpkt.pcap import UniversalReader

    with path.open("rb") as file:
        reader = UniversalReader(file)
        link = str(reader.datalink())
        for _, frame in reader:
            yield link, frame


def pcap_dpkt(path: Path) -> Iterator[Message]:
    from dpkt.ethernet import Ethernet
    from dpkt.pcap import UniversalReader
    from dpkt.udp import UDP

    with path.open("rb") as file:
        for _, frame in UniversalReader(file):
            network = Ethernet(frame).data
            datagram = getattr(network, "data", None)
            if isinstance(datagram, UDP):
                yield f"{'.'.join(map(str, network.src))}:{datagram.dport}", bytes(datagram.data)


WAYS: dict[str, dict[str, Way]] = {
    "mcap": {
        "ours": mcap_ours,
        "mcap, by its index": mcap_seeking,
        "mcap, in a stream": mcap_streaming,
        "rosbags": rosbags_rosbag2,
    },
    "db3": {"ours": sqlite_ours, "rosbags": rosbags_rosbag2},
    "foxglove": {"ours": foxglove_ours, "mcap-protobuf-support": foxglove_support},
    "pcap": {
        "ours": pcap_ours,
        "dpkt": pcap_dpkt,
        "ours, frames alone": pcap_container_ours,
        "dpkt, frames alone": pcap_container_dpkt,
    },
}
