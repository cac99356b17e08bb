"""A recording whose sensors are topics, whatever file holds them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from importlib import import_module
from itertools import islice
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.readings import ReadOptions
from apexcal.documents.recordings import FixedFrame
from workers.readers.captures.packet_source import SAMPLE_PACKETS, Packet, PacketSource, PacketStream, SweepCutter
from workers.readers.clouds.fields import Columns
from workers.readers.clouds.model import SAMPLES, CloudModel, learn_clouds
from workers.readers.clouds.pointcloud2 import cloud_columns
from workers.readers.damage import on_error
from workers.readers.images.still_images import image_frame
from workers.readers.images.transcode import raw_to_png
from workers.readers.omissions import Omissions, readable
from workers.readers.recording import Frame, LidarFacts, MessageError, ReadError, Recording, Sensor, Sweep
from workers.readers.ros.camera_info import image_kind, info_document, match_infos
from workers.readers.ros.containers import Container
from workers.readers.ros.first_messages import first_message
from workers.readers.ros.livox import LIVOX_CLOUDS
from workers.readers.ros.message_stamps import MessageStamps
from workers.readers.ros.packet_topics import is_stampless, packet_source, stamped_packets
from workers.readers.ros.ros_types import full_name
from workers.readers.ros.static_transforms import static_transforms
from workers.readers.ros.topic_messages import (
    CameraInfo,
    CloudMessage,
    Decoder,
    EncodedImage,
    Message,
    PacketMessage,
    RawImage,
    VideoMessage,
    described,
    topic_sensor,
)

if TYPE_CHECKING:
    from workers.readers.ros.message_video import MessageVideo

_MAX_TOPICS: Final = 10_000
_INFOS: Final = ("CameraInfo", "CameraCalibration")
_UNDECODED: Final = MessageError(
    "video_damaged",
    "Frames of video before the first key frame can never be decoded, nor those after a message that is missing.",
    "Start the recording before the camera, or let the encoder send key frames more often.",
)
# What is wrong with one topic's own description is no reason to refuse the others.
_OWN: Final = frozenset({"type_not_understood", "lidar_metadata_unusable"})


class TopicRecording(Recording):
    """The topics of a container that are LiDARs and cameras.

    JPEG, PNG and WebP images are handed on byte for byte; raw images become PNG.

    Args:
        container: open; closed with this.
        options: what the owner knows.

    Raises:
        ReadError: what the container raises.
    """

    def __init__(self, container: Container, options: ReadOptions) -> None:
        self.format = container.format
        self._container = container
        self._options = options
        self._models: dict[str, CloudModel] = {}
        self._sources: dict[str, PacketSource] = {}
        self._streams: dict[str, PacketStream] = {}
        self._cutters: dict[str, SweepCutter] = {}
        self._videos: dict[str, MessageVideo] = {}
        self._decoders: dict[str, Decoder] = {}
        self._message_stamps = MessageStamps(container, self._decoders)
        self._sentences: list[str] = []
        self._omissions = Omissions()
        self._unfilled = Omissions()
        with on_error(container.close):
            self.sensors, self.other_topics = self._find_sensors()

    def _find_sensors(self) -> tuple[list[Sensor], list[str]]:
        """The topics that are a LiDAR's or a camera's, and the remaining ones with their types."""
        sensors: list[Sensor] = []
        others: list[str] = []
        infos: dict[str, CameraInfo] = {}
        for topic in self._container.topics[:_MAX_TOPICS]:
            try:
                decoder = self._container.decoder(topic)
                first = None if decoder is None else first_message(self._container, topic, decoder, self._unfilled)
                if isinstance(first, PacketMessage):
                    source = packet_source(self._container, topic, first)
                    decoder = decoder if source else None
                    self._sources |= {topic.name: source} if source else {}
            except ReadError as error:
                if error.code not in _OWN:
                    raise
                others.append(f"{described(topic)}: {error.message}")
                continue
            if decoder is None or isinstance(first, CameraInfo) or (first is None and topic.type.endswith(_INFOS)):
                others.append(described(topic))
                if isinstance(first, CameraInfo):
                    infos[topic.name] = first
                continue
            self._decoders[topic.name] = decoder
            sensors.append(topic_sensor(topic, first))
        matched = match_infos({s.name: s.frame_id for s in sensors if s.kind == "camera"}, infos)
        return [_with_info(s, matched.get(s.name)) if s.kind == "camera" else s for s in sensors], others

    @property
    def omissions(self) -> Omissions:
        """Messages of chosen topics, and of CameraInfo."""
        every = Omissions()
        every.update(self._unfilled)
        every.update(self._omissions)
        return every

    @property
    def static_transforms(self) -> Sequence[FixedFrame]:
        """The transforms of its ``/tf_static``."""
        return static_transforms(self._container, self._sentences)

    @property
    def share_read(self) -> float | None:
        """Share of the file that has been read, where the container knows it."""
        return self._container.share_read

    @property
    def warnings(self) -> list[str]:
        """Sentences about what was met while reading."""
        sources = (*self._models.values(), *self._cutters.values())
        return [
            *self._container.warnings,
            *self._sentences,
            *(line for source in sources for line in source.warnings()),
            *(
                f"{topic}: messages have no stamp of their own; the time of recording was taken."
                for topic in sorted(self._message_stamps.stampless)
            ),
        ]

    def lidar_facts(self, sensor: Sensor) -> LidarFacts:
        """The facts learned of a LiDAR from sweeps spread over the file, or from its first packets."""
        if sensor.name in self._sources:
            return self._stream(sensor).facts
        return self._model(sensor).facts

    def log_times(self, sensor: Sensor) -> NDArray[np.int64]:
        """Times of recording of all messages."""
        return self._container.log_times(sensor.name)

    def log_and_stamp(self, sensor: Sensor, count: int) -> Iterator[tuple[int, int]]:
        """Return time of recording and stamp of messages with a stamp of their own."""
        return self._message_stamps.samples(sensor.name, count)

    def stamps(self, sensors: Sequence[Sensor]) -> Iterator[tuple[Sensor, int, int]]:
        """Yield the stamps of messages. A driver's packets count one by one: each holds a part of a sweep."""
        by_name = {sensor.name: sensor for sensor in sensors}
        for name, log_ns, raw in self._container.messages(by_name) if by_name else ():
            with suppress(MessageError):
                yield by_name[name], self._message_stamps.of(name, self._decoders[name](raw), log_ns), log_ns

    def _model(self, sensor: Sensor) -> CloudModel:
        if sensor.name not in self._models:
            times = np.sort(self._container.times(sensor.name))
            period = int(np.median(np.diff(times))) if len(times) > 2 else None
            options = self._options
            if options.rings is None and full_name(sensor.notes.get("type", "")) in LIVOX_CLOUDS:
                options = options.model_copy(update={"rings": 1})
            self._models[sensor.name] = learn_clouds(self._samples(sensor), period, options, sensor.name)
        return self._models[sensor.name]

    def _samples(self, sensor: Sensor) -> Iterator[tuple[int, Columns]]:
        samples = self._container.samples(sensor.name, SAMPLES)
        return readable(partial(self._columns, sensor.name, log_ns, raw) for log_ns, raw in samples)

    def _columns(self, name: str, log_ns: int, raw: bytes) -> tuple[int, Columns]:
        message = self._decoders[name](raw)
        stamp_ns = self._message_stamps.of(name, message, log_ns)
        assert isinstance(message, CloudMessage)
        return stamp_ns, cloud_columns(message.cloud, _where(name, stamp_ns))

    def _stream(self, sensor: Sensor) -> PacketStream:
        if sensor.name not in self._streams:
            messages = self._container.messages([sensor.name])
            turns = readable(partial(self._packets, sensor, log_ns, raw) for _, log_ns, raw in messages)
            sample = list(islice((packet for packets in turns for packet in packets), SAMPLE_PACKETS))
            self._streams[sensor.name] = self._sources[sensor.name].learn(sample, self._options, sensor.name)
        return self._streams[sensor.name]

    def _packets(self, sensor: Sensor, log_ns: int, raw: bytes) -> Sequence[Packet]:
        message = self._decoders[sensor.name](raw)
        if not isinstance(message, PacketMessage):
            return ()
        if is_stampless(message):
            self._message_stamps.stampless.add(sensor.name)
        return stamped_packets(message, self._sources[sensor.name], log_ns)

    def messages(self, sensors: Sequence[Sensor]) -> Iterator[tuple[Sensor, Sweep | Frame]]:
        """All chosen topics in one pass, in recorded order."""
        by_name = {sensor.name: sensor for sensor in sensors}
        self._videos.clear()
        self._cutters.clear()
        self._omissions.clear(by_name)
        for sensor in sensors:  # what is not usable is said before anything is read
            if sensor.name in self._sources:
                self._cutters[sensor.name] = self._stream(sensor).cutter()
            elif sensor.kind == "lidar":
                self._model(sensor)
        last_ns: dict[str, int] = {}
        for name, log_ns, raw in self._container.messages(by_name) if by_name else ():
            last_ns[name] = log_ns
            with self._omissions.leaving_out(name):
                for item in self._items(by_name[name], log_ns, raw):
                    yield by_name[name], replace(item, log_ns=log_ns)
        for name, cutter in self._cutters.items():
            for sweep in filter(None, [cutter.finish()]):
                yield by_name[name], replace(sweep, log_ns=last_ns[name])
        for name, video in self._videos.items():
            for frame in video.finish():
                yield by_name[name], replace(frame, log_ns=last_ns[name])
            if video.missing:
                self._omissions.add(name, _UNDECODED, count=video.missing)

    def samples(self, sensor: Sensor, count: int) -> Iterator[Sweep | Frame]:
        """Sweeps or frames spread over the file; of packets and of video the first."""
        if sensor.name in self._sources:
            yield from super().samples(sensor, count)
            return
        if sensor.kind == "lidar":
            self._model(sensor)
        self._omissions.clear([sensor.name])
        for log_ns, raw in self._container.samples(sensor.name, count):
            with self._omissions.leaving_out(sensor.name):
                message = self._decoders[sensor.name](raw)
                if isinstance(message, VideoMessage):
                    yield from super().samples(sensor, count)
                    return
                yield from self._stamped(sensor.name, message, log_ns)

    def _items(self, sensor: Sensor, log_ns: int, raw: bytes) -> Iterator[Sweep | Frame]:
        """Yield what a message holds or completes."""
        name = sensor.name
        if name in self._cutters:
            packets = self._packets(sensor, log_ns, raw)
            yield from filter(None, (self._cutters[name].add(*packet) for packet in packets))
            return
        yield from self._stamped(name, self._decoders[name](raw), log_ns)

    def _stamped(self, name: str, message: Message, log_ns: int) -> Iterator[Sweep | Frame]:
        """Yield what a message holds, if it can be used. Raises MessageError if it has no stamp."""
        stamp_ns = self._message_stamps.of(name, message, log_ns)
        with self._omissions.leaving_out(name, stamp_ns):
            yield from self._usable(name, message, stamp_ns)

    def _usable(self, name: str, message: Message, stamp_ns: int) -> Iterator[Sweep | Frame]:
        """Yield what a message holds. Raises MessageError if it cannot be used."""
        where = _where(name, stamp_ns)
        if isinstance(message, VideoMessage):
            if not message.data:  # which would end the decoder
                raise MessageError("image_empty", f"{where} holds no bytes.", "Look at the camera's driver.")
            yield from self._video(name, message).add(stamp_ns, message.data)
        elif isinstance(message, CloudMessage) and name in self._models:
            yield self._models[name].sweep(stamp_ns, cloud_columns(message.cloud, where))
        elif isinstance(message, EncodedImage):
            yield image_frame(message.data, stamp_ns, where, message.encoding)
        elif isinstance(message, RawImage):
            yield raw_to_png(message, stamp_ns, where)

    def _video(self, name: str, first: VideoMessage) -> MessageVideo:
        if name not in self._videos:
            # PyAV is loaded only where there is video.
            video: MessageVideo = import_module("workers.readers.ros.message_video").MessageVideo(first.codec, name)
            self._videos[name] = video
        return self._videos[name]

    def close(self) -> None:
        """Close the file."""
        self._container.close()


def _where(topic: str, stamp_ns: int) -> str:
    return f"The message on {topic} at {stamp_ns / 1e9:.3f} s"


def _with_info(camera: Sensor, info: CameraInfo | None) -> Sensor:
    document = info and info_document(info, camera.image_size)
    notes = camera.notes if document or not info else {**camera.notes, "camera_info": "unusable"}
    return replace(camera, camera_info=document, image_kind=image_kind(camera.name, document), notes=notes)
