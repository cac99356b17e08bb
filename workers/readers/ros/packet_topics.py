"""Topics of LiDARs' packets: which can be read, and the packets of their messages with the host's stamps."""

from __future__ import annotations

from collections.abc import Sequence

from workers.readers.captures.ouster.cutter import OusterSource
from workers.readers.captures.ouster.metadata import read_metadata
from workers.readers.captures.packet_source import Packet, PacketSource
from workers.readers.captures.velodyne.cutter import VelodyneSource
from workers.readers.captures.velodyne.stream import evened
from workers.readers.ros.containers import Container
from workers.readers.ros.ros_types import TEXT, full_name, message_reader
from workers.readers.ros.topic_messages import BagTopic, PacketMessage


def packet_source(container: Container, topic: BagTopic, first: PacketMessage) -> PacketSource | None:
    """Whose the packets of a topic are; None where they cannot be read.

    An Ouster's are read by what the sensor says of itself on the topic ``metadata`` beside it. The packets of its
    inertial unit are none of the sensor's.

    Raises:
        ReadError: ``lidar_metadata_unusable``, ``recording_damaged``.
    """
    if first.maker == VelodyneSource.maker:
        return VelodyneSource()
    name = f"{topic.name.rpartition('/')[0]}/metadata"
    beside = next((each for each in container.topics if each.name == name), None)
    if beside is None or full_name(beside.type) != TEXT or beside.encoding not in ("ros1", "cdr"):
        return None
    with container.damage():
        texts = [str(message_reader(beside)(raw).data) for _, raw in container.samples(name, 1)]
    source = OusterSource(read_metadata(texts[0].encode(errors="replace"), name)) if texts else None
    return source if source and any(source.takes(data) for _, data in first.packets) else None


def is_stampless(message: PacketMessage) -> bool:
    """Whether the driver, which states stamps, left them out."""
    return message.maker == VelodyneSource.maker and any(host_ns == 0 for host_ns, _ in message.packets)


def stamped_packets(message: PacketMessage, source: PacketSource, log_ns: int) -> Sequence[Packet]:
    """The packets of a message, with the time of recording where they have no stamps.

    Args:
        message: Velodyne's driver sends a turn's packets together, Ouster's each by itself.
        source: whose they are.
        log_ns: when the message was recorded.
    """
    if message.maker == OusterSource.maker:
        return [(log_ns, data) for _, data in message.packets if source.takes(data)]
    if is_stampless(message):
        return evened(log_ns, [data for _, data in message.packets])
    return message.packets
