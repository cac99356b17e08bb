"""The transforms that a recording states once and for all: its ``/tf_static`` and its ``/robot_description``."""

from __future__ import annotations

import math
from typing import Any, Final

from rosbags.serde import SerdeError

from apexcal.documents.errors import InputError
from apexcal.documents.recordings import FixedFrame
from apexcal.geometry.urdf_tree import read_joints
from workers.readers.damage import damage
from workers.readers.recording import ReadError, legible
from workers.readers.ros.containers import Container
from workers.readers.ros.ros_types import TEXT, TRANSFORMS, full_name, message_reader
from workers.readers.ros.topic_messages import BagTopic

_NAME: Final = "tf_static"
_DESCRIPTION: Final = "robot_description"
# Every node publishes its own once; a recorder that splits its files repeats them.
_MESSAGES: Final = 500
_MOST: Final = 2000
_LONGEST_NAME: Final = 200
# Metres; products of larger numbers are no numbers.
_FARTHEST: Final = 1000.0


def is_static_transforms(topic: BagTopic) -> bool:
    """Whether a topic holds transforms that never change, in a type that is read."""
    return (
        topic.name.rpartition("/")[2] == _NAME
        and full_name(topic.type) in TRANSFORMS
        and topic.encoding in ("ros1", "cdr")
    )


def static_transforms(container: Container, warnings: list[str]) -> list[FixedFrame]:
    """Return the transforms of all ``tf_static`` topics. As in tf2, a child's later transform replaces the earlier.

    The fixed joints of a ``robot_description`` place the children that no ``tf_static`` does.
    """
    by_child: dict[str, FixedFrame] = {}
    for topic in container.topics:
        if _is_description(topic):
            by_child = {each.child: each for each in _described(container, topic, warnings)} | by_child
        if is_static_transforms(topic):
            try:
                for stated in _stated(container, topic):
                    by_child[stated.child] = stated
            except ReadError as error:  # no reason to refuse what the sensors recorded
                warnings.append(f"{topic.name} was left out: {error.message}")
    if len(by_child) > _MOST:
        warnings.append(
            f"{len(by_child)} frames are stated to be fixed; at most {_MOST} are read, so they were left out."
        )
        return []
    return list(by_child.values())


def _is_description(topic: BagTopic) -> bool:
    is_named = topic.name.rpartition("/")[2] == _DESCRIPTION
    return is_named and full_name(topic.type) == TEXT and topic.encoding in ("ros1", "cdr")


def _described(container: Container, topic: BagTopic, warnings: list[str]) -> list[FixedFrame]:
    """The fixed joints of the newest robot description; none where it is no URDF."""
    text = ""
    try:
        with damage(topic.name, "a robot description", "Look at who publishes it.", SerdeError):
            for _, raw in container.samples(topic.name, 1):
                text = str(message_reader(topic)(raw).data)
        joints = [joint for joint in read_joints(text.encode()).values() if joint.kind == "fixed"]
        poses = [joint.T_parent_child for joint in joints]
    except (ReadError, InputError, UnicodeEncodeError) as error:
        warnings.append(legible(f"{topic.name} was left out: {getattr(error, 'message', error)}"))
        return []
    return [
        FixedFrame(
            parent=pose.to_frame,
            child=pose.from_frame,
            translation_m=pose.t.tolist(),
            quaternion_xyzw=list(pose.quaternion_xyzw),
            origin="robot_description",
        )
        for pose in poses
        if _frame(pose.to_frame) and _frame(pose.from_frame) and pose.to_frame != pose.from_frame
    ]


def _stated(container: Container, topic: BagTopic) -> list[FixedFrame]:
    read = message_reader(topic)
    with damage(topic.name, "a topic of fixed transforms", "Look at who publishes it.", SerdeError):
        messages = (read(raw) for _, raw in container.samples(topic.name, _MESSAGES))
        stated = [_transform(transform) for message in messages for transform in message.transforms]
    return [transform for transform in stated if transform]


def _transform(stamped: Any) -> FixedFrame | None:
    """Return a message's transform; None if it is none, or if a frame's name cannot be used."""
    t, q = stamped.transform.translation, stamped.transform.rotation
    parent, child = (_frame(name) for name in (stamped.header.frame_id, stamped.child_frame_id))
    offset, turn = [float(t.x), float(t.y), float(t.z)], [float(q.x), float(q.y), float(q.z), float(q.w)]
    length = math.hypot(*turn)
    is_sound = math.isfinite(length) and length > 0.0 and all(abs(value) <= _FARTHEST for value in offset)
    if not parent or not child or parent == child or not is_sound:
        return None
    quaternion_xyzw = [value / length for value in turn]
    return FixedFrame(parent=parent, child=child, translation_m=offset, quaternion_xyzw=quaternion_xyzw)


def _frame(name: object) -> str:
    """A frame's name as tf2 compares it: without the slash of older versions."""
    text = str(name).removeprefix("/")
    return text if len(text) <= _LONGEST_NAME and legible(text) == text else ""
