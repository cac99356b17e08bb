"""Which of a recording's topics are the rig's LiDAR and cameras: by name, or by a guess that cannot go wrong."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Final

from workers.readers.clouds import RING_FIELDS
from workers.readers.recording import ReadError, Recording, Sensor

CameraChoice = Mapping[str, str | None] | Sequence[str] | None
_CAMERA_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")


def choose_sensors(recording: Recording, lidar: str | None, cameras: CameraChoice) -> dict[str, Sensor]:
    """The recording's sensors by the rig's names: ``lidar`` first, then each camera.

    Args:
        recording: an opened recording.
        lidar: topic or folder of the LiDAR; None: the only one.
        cameras: the rig's camera names, each with its topic or None, or names only; None: every camera topic, named
            after it.

    Raises:
        ReadError: ``no_lidar_topic``, ``no_camera_topic``, ``topic_not_found``, ``ambiguous_lidar``,
            ``ambiguous_cameras``, ``camera_name_invalid``.
    """
    chosen = {"lidar": _lidar(recording, lidar)}
    topics = [s for s in recording.sensors if s.kind == "camera" and s.count != 0]
    if cameras is None:
        cameras = {_slug(topic.name): topic.name for topic in _without_twins(topics)}
    wanted = dict(cameras) if isinstance(cameras, Mapping) else dict.fromkeys(cameras)
    for name in wanted:
        if not _CAMERA_NAME.fullmatch(name) or name == "lidar":
            raise ReadError(
                "camera_name_invalid",
                f"{name!r} cannot name a camera, because its files are named after it.",
                "Use letters, digits, '_', '-' and '.', at most 64, and not 'lidar'.",
            )
    chosen |= _cameras(recording, topics, wanted)
    names = [sensor.name for sensor in chosen.values()]
    for name in names:
        if names.count(name) > 1:
            raise ReadError("ambiguous_cameras", f"{name} was named for two cameras.", "Give each its own topic.")
    return chosen


def _contents(recording: Recording) -> str:
    known = [f"{s.name} ({s.kind}, {s.count if s.count is not None else '?'} messages)" for s in recording.sensors]
    return "It holds: " + (", ".join([*known, *recording.other_topics]) or "no messages") + "."


def _by_name(recording: Recording, kind: str, name: str) -> Sensor:
    for sensor in recording.sensors:
        if sensor.kind == kind and sensor.name == name:
            return sensor
    what = "LiDAR" if kind == "lidar" else "camera"
    raise ReadError(
        "topic_not_found",
        f"There is no {what} topic {name!r} in the recording. {_contents(recording)}",
        "Choose one of these topics in the rig, or when uploading.",
    )


def _lidar(recording: Recording, name: str | None) -> Sensor:
    if name is not None:
        return _by_name(recording, "lidar", name)
    clouds = [s for s in recording.sensors if s.kind == "lidar" and s.count != 0]
    if not clouds:
        raise ReadError(
            "no_lidar_topic",
            f"No LiDAR was found in the recording. {_contents(recording)}",
            "Record the LiDAR's point cloud (sensor_msgs/PointCloud2, or .pcd files) together with the camera.",
        )
    ringed = [s for s in clouds if not set(RING_FIELDS).isdisjoint(s.notes.get("fields", "").split())]
    candidates = ringed or clouds
    if len(candidates) > 1:
        raise ReadError(
            "ambiguous_lidar",
            f"{len(candidates)} topics could be the LiDAR: {', '.join(s.name for s in candidates)}.",
            "Name the LiDAR's topic in the rig, or when uploading.",
        )
    return candidates[0]


def _without_twins(topics: Sequence[Sensor]) -> list[Sensor]:
    """Topics without the raw form of a camera that is there compressed too (image_transport's names)."""
    names = {topic.name for topic in topics}
    return [topic for topic in topics if f"{topic.name}/compressed" not in names]


def _slug(topic: str) -> str:
    words = [w for w in re.split(r"[^A-Za-z0-9]+", topic.removesuffix("/compressed")) if w]
    return "_".join(words).lower()[:64] or "camera"


def _cameras(recording: Recording, topics: Sequence[Sensor], wanted: Mapping[str, str | None]) -> dict[str, Sensor]:
    chosen = {name: _by_name(recording, "camera", topic) for name, topic in wanted.items() if topic is not None}
    open_names = [name for name, topic in wanted.items() if topic is None]
    if not open_names:
        return {name: chosen[name] for name in wanted}
    taken = {sensor.name for sensor in chosen.values()}
    free = [topic for topic in _without_twins(topics) if topic.name not in taken]
    if len(free) < len(open_names):
        code = "no_camera_topic" if not topics else "ambiguous_cameras"
        raise ReadError(
            code,
            f"The rig has {len(wanted)} cameras; the recording has topics for {len(free) + len(taken)}. "
            f"{_contents(recording)}",
            "Record every camera of the rig as sensor_msgs/CompressedImage or Image, or leave a camera out.",
        )
    if len(open_names) == 1 and len(free) == 1:
        chosen[open_names[0]] = free[0]
    else:
        chosen.update(_by_words(open_names, free))
    return {name: chosen[name] for name in wanted}


def _by_words(names: Sequence[str], free: Sequence[Sensor]) -> dict[str, Sensor]:
    """Each camera's topic where exactly one topic's name holds the camera's name, and no topic is taken twice."""
    found = {name: [t for t in free if _slug(name) in _slug(t.name)] for name in names}
    picked = [matches[0].name for matches in found.values() if len(matches) == 1]
    if len(picked) != len(names) or len(set(picked)) != len(picked):
        raise ReadError(
            "ambiguous_cameras",
            f"Which topic belongs to which camera is not clear: cameras {', '.join(names)}; "
            f"topics {', '.join(t.name for t in free)}.",
            "Name each camera's topic in the rig, or when uploading.",
        )
    return {name: matches[0] for name, matches in found.items()}
