"""Decides for each message of a bag whether it stays, is replaced, or is followed by one that is added."""

from __future__ import annotations

import posixpath
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from workers.readers.copying.edits import CameraEdit, EditCounts, Edits
from workers.readers.copying.messages import Messages
from workers.readers.recording import ReadError
from workers.readers.ros.camera_info import match_infos, without_transport
from workers.readers.ros.containers import Container
from workers.readers.ros.ros_types import INFO, TRANSFORM, TRANSFORMS, fixed_types, full_name
from workers.readers.ros.static_transforms import is_static_transforms
from workers.readers.ros.topic_messages import BagTopic, CameraInfo

_ENDLESS: Final = "{sec: 9223372036, nsec: 854775807}"


def _profile(durability: int) -> str:
    # history: keep last; reliability: reliable; liveliness: automatic.
    lines = (
        "- history: 1",
        "depth: 1",
        "reliability: 1",
        f"durability: {durability}",
        f"deadline: {_ENDLESS}",
        f"lifespan: {_ENDLESS}",
        "liveliness: 1",
        f"liveliness_lease_duration: {_ENDLESS}",
        "avoid_ros_namespace_conventions: false",
    )
    return "\n  ".join(lines)


LATCHED_QOS: Final = _profile(1)  # transient local
SENSOR_QOS: Final = _profile(2)  # volatile

_TF: Final = "tf"
_TF_STATIC: Final = "/tf_static"


@dataclass(frozen=True, slots=True)
class NewTopic:
    """A topic that the recording does not have yet; ``latched``: late subscribers get its last messages."""

    name: str
    type: str
    encoding: str
    latched: bool = False

    @property
    def qos(self) -> str:
        """Its quality of service, as rosbag2 stores it."""
        return LATCHED_QOS if self.latched else SENSOR_QOS

    @property
    def definition(self) -> str:
        """The text of its type's definition in its encoding's notation."""
        version = 1 if self.encoding == "ros1" else 2
        return fixed_types(self.encoding).generate_msgdef(self.type, ros_version=version)[0]

    @property
    def type_hash(self) -> str:
        """Return the hash that rosbag2 writes of its type."""
        return fixed_types("cdr").hash_rihs01(self.type)


@dataclass(frozen=True, slots=True)
class Added:
    """A message to add, with its time of recording."""

    topic: str
    log_ns: int
    data: bytes


class Editor:
    """Knows a bag's topics, and what becomes of each of their messages."""

    def __init__(self, container: Container, edits: Edits) -> None:
        self.counts = EditCounts()
        self._edits = edits
        topics = {topic.name: topic for topic in container.topics}
        self._encodings = {name: topic.encoding for name, topic in topics.items()}
        self._messages = {encoding: Messages(encoding) for encoding in ("ros1", "cdr")}
        self._static = {name for name, topic in topics.items() if is_static_transforms(topic)}
        self._moving = {name for name, topic in topics.items() if _is_moving(topic)}
        has_ros = [camera for camera in edits.cameras if self._encodings.get(camera.topic) in self._messages]
        decoders = {camera.topic: container.decoder(topics[camera.topic]) for camera in has_ros}
        self._decoders = {topic: decoder for topic, decoder in decoders.items() if decoder}
        here = [camera for camera in has_ros if camera.topic in self._decoders]
        cameras = {camera.topic: camera for camera in here}
        self._found_topics = set(cameras)
        self._infos = _infos_of(container, cameras)
        replaced = {camera.topic for camera in self._infos.values()}
        self._new_infos = {
            camera.topic: (camera, _info_topic(camera, edits.cameras, topics))
            for camera in here
            if camera.topic not in replaced
        }
        self._found: set[str] = set()
        self.has_begun = False

    @property
    def new_topics(self) -> list[NewTopic]:
        """Topics to make."""
        infos = [NewTopic(name, INFO, self._encodings[topic]) for topic, (_, name) in self._new_infos.items()]
        poses = self._new_pose_topic
        if poses is not None and poses not in self._static:
            infos.append(NewTopic(poses, TRANSFORM, self._first_encoding, latched=True))
        return infos

    @property
    def _first_encoding(self) -> str:
        here = sorted(self._found_topics & self._encodings.keys())
        return self._encodings[here[0]] if here else "cdr"

    @property
    def _new_pose_topic(self) -> str | None:
        if not any(pose.is_new for pose in self._edits.poses):
            return None
        return _TF_STATIC if _TF_STATIC in self._static or not self._static else min(self._static)

    def take(self, topic: str, log_ns: int, raw: bytes) -> tuple[bytes, list[Added]]:
        """Return a message as it is to be written, the same object if nothing of it changes, and what follows it.

        Raises:
            ReadError: ``frame_moves``, a frame whose pose is put in is placed by a moving transform.
        """
        edited = raw
        if topic in self._infos:
            edited = self._messages[self._encodings[topic]].with_lens(raw, self._infos[topic])
        elif topic in self._static:
            edited, children = self._messages[self._encodings[topic]].with_poses(raw, self._edits.poses)
            self._found |= children
        elif topic in self._moving:
            self._check_moving(topic, raw)
        self.counts.copied += edited is raw
        self.counts.replaced += edited is not raw
        return edited, self._info_beside(topic, log_ns, raw)

    def begin(self, log_ns: int) -> list[Added]:
        """Return what is added before the first message; ``has_begun`` says that it was called."""
        self.has_begun = True
        topic = self._new_pose_topic
        if topic is None:
            return []
        new = [pose for pose in self._edits.poses if pose.is_new]
        self.counts.added += 1
        encoding = self._encodings.get(topic, self._first_encoding)
        return [Added(topic, log_ns, self._messages[encoding].new_poses(new, log_ns))]

    def _info_beside(self, topic: str, log_ns: int, raw: bytes) -> list[Added]:
        """Return the intrinsics beside an image that has none."""
        if topic not in self._new_infos:
            return []
        camera, name = self._new_infos[topic]
        encoding = self._encodings[topic]
        image = self._decoders[topic](raw)
        self.counts.added += 1
        frame_id = image.frame_id or camera.frame_id
        return [Added(name, log_ns, self._messages[encoding].new_info(camera, image.stamp_ns, frame_id))]

    def check_complete(self) -> None:
        """Raises :class:`ReadError` ``copy_not_possible`` if a pose to replace was not found, or if a camera's topic
        is missing or has no ROS encoding.
        """
        for camera in self._edits.cameras:
            if camera.topic not in self._found_topics:
                raise ReadError(
                    "copy_not_possible",
                    f"This file has no ROS messages with images of {camera.name} ({camera.topic}).",
                    "Only ROS messages are copied. `apexcal export --format ros2` writes files to play beside it.",
                )
        missing = [pose.child for pose in self._edits.poses if not pose.is_new and pose.child not in self._found]
        if missing:
            raise ReadError(
                "copy_not_possible",
                f"No message places the frame {missing[0]!r}, although the recording's facts say so.",
                "Read the recording again, then ask again.",
            )

    def _check_moving(self, topic: str, raw: bytes) -> None:
        moving = set(self._messages[self._encodings[topic]].children(raw))
        for pose in self._edits.poses:
            if pose.child in moving:
                raise ReadError(
                    "frame_moves",
                    f"{topic} moves the frame {pose.child!r}, so it has no fixed pose to put in.",
                    "A calibration holds along fixed joints. Name another joint.",
                )


def _is_moving(topic: BagTopic) -> bool:
    is_tf = topic.name.rpartition("/")[2] == _TF and full_name(topic.type) in TRANSFORMS
    return is_tf and topic.encoding in ("ros1", "cdr")


def _infos_of(container: Container, cameras: dict[str, CameraEdit]) -> dict[str, CameraEdit]:
    """Return the camera of each topic of intrinsics."""
    first: dict[str, CameraInfo] = {}
    for topic in container.topics:
        if full_name(topic.type) != INFO or topic.encoding not in ("ros1", "cdr"):
            continue
        decoder = container.decoder(topic)
        for _, raw in container.samples(topic.name, 1):
            message = decoder(raw) if decoder else None
            if isinstance(message, CameraInfo):
                first[topic.name] = message
    matched = match_infos({topic: camera.frame_id for topic, camera in cameras.items()}, first)
    return {
        name: cameras[topic]
        for topic, info in matched.items()
        for name, of_topic in first.items()
        if of_topic is info
    }


def _info_topic(camera: CameraEdit, cameras: Sequence[CameraEdit], topics: dict[str, BagTopic]) -> str:
    """Return the topic where image_transport looks for an image's intrinsics, if it is free and no other camera's."""
    base = {other.topic: without_transport(other.topic) for other in cameras}
    folder = posixpath.dirname(base[camera.topic])
    beside = posixpath.join(folder, "camera_info")
    shared = sum(posixpath.dirname(other) == folder for other in base.values()) > 1
    return f"{base[camera.topic]}/camera_info" if shared or beside in topics else beside
