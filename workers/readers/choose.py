"""Choose the topics of the rig's LiDAR and cameras: by name, or by a guess that is clear; else ask."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, Final

from workers.readers.camera_guess import Sizes, guess_cameras
from workers.readers.captures.other_makers import instead, maker_of_topic
from workers.readers.clouds.fields import meanings
from workers.readers.recording import ReadError, Recording, Sensor
from workers.readers.topic_words import primary, short_name

CameraChoice = Mapping[str, str | None] | Sequence[str] | None
_CAMERA_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")
_MOST_LISTED: Final = 100
_MOST_SENSORS: Final = 2000


def choose_sensors(
    recording: Recording, lidar: str | None, cameras: CameraChoice, sizes: Sizes | None = None
) -> dict[str, Sensor]:
    """The recording's sensors by the rig's names: ``lidar`` first, then each camera.

    Args:
        recording: an opened recording.
        lidar: topic or folder of the LiDAR; None: the only one, or the one that is clearly its driver's.
        cameras: topics by the rig's camera names, None for a topic to guess; or names alone, to guess all topics.
            None: every camera topic is a camera with the topic's name.
        sizes: (width, height) of the cameras' images where the rig says it.

    Raises:
        ReadError: ``no_lidar_topic``, ``lidar_packets_not_read``, ``no_camera_topic``, ``topic_not_found``,
            ``ambiguous_lidar``, ``ambiguous_cameras``, each with ``candidates`` in its fields (and ``cameras``, the
            names that wait for a topic); ``camera_name_invalid``; ``too_many_sensors``.
    """
    if len(recording.sensors) > _MOST_SENSORS:
        raise ReadError(
            "too_many_sensors",
            f"The recording has {len(recording.sensors)} topics or folders of clouds and images; at most "
            f"{_MOST_SENSORS} are read.",
            "All files of a sensor belong in one folder. Upload the rig's own sensors only.",
            {"candidates": candidates(recording.sensors)},
        )
    chosen = {"lidar": _lidar(recording, lidar)}
    topics = [s for s in recording.sensors if s.kind == "camera" and s.count != 0]
    rig_topics = _named_after(topics) if cameras is None else _wanted(cameras)
    for name in rig_topics:
        if not _CAMERA_NAME.fullmatch(name) or name == "lidar":
            raise ReadError(
                "camera_name_invalid",
                f"{name!r} cannot name a camera, because its files are named after it.",
                "Use letters, digits, '_', '-' and '.', at most 64, and not 'lidar'.",
            )
    chosen |= _cameras(recording, topics, rig_topics, sizes or {})
    for name, count in Counter(sensor.name for sensor in chosen.values()).items():
        if count > 1:
            raise ReadError(
                "ambiguous_cameras",
                f"{name} was named for two cameras.",
                "Give each its own topic.",
                {"candidates": candidates(topics), "cameras": list(rig_topics)},
            )
    return chosen


def candidates(sensors: Sequence[Sensor]) -> list[dict[str, Any]]:
    """Return the topics that a program may offer its user to choose from, as plain data."""
    listed: list[dict[str, Any]] = []
    for sensor in sensors[:_MOST_LISTED]:
        entry: dict[str, Any] = {name: getattr(sensor, name) for name in ("name", "kind", "count", "frame_id")}
        entry |= {key: int(sensor.notes[key]) for key in ("width", "height") if sensor.notes.get(key, "").isdigit()}
        listed.append(entry | {key: sensor.notes[key] for key in ("fields", "rate_hz") if sensor.notes.get(key)})
    return listed


def _wanted(cameras: Mapping[str, str | None] | Sequence[str]) -> dict[str, str | None]:
    return dict(cameras) if isinstance(cameras, Mapping) else dict.fromkeys(cameras)


def _named_after(topics: Sequence[Sensor]) -> dict[str, str | None]:
    """Return a name for each camera topic. A number tells equal names apart."""
    named: dict[str, str | None] = {}
    for topic in primary(topics):
        name, number = short_name(topic.name), 2
        while name in named or name == "lidar":
            name, number = f"{short_name(topic.name)[:60]}_{number}", number + 1
        named[name] = topic.name
    return named


def _contents(recording: Recording) -> str:
    sensors = [f"{s.name} ({s.kind}, {s.count if s.count is not None else '?'} messages)" for s in recording.sensors]
    listed = [*sensors, *recording.other_topics]
    more = [f"and {len(listed) - _MOST_LISTED} more"] if len(listed) > _MOST_LISTED else []
    return "It holds: " + (", ".join(listed[:_MOST_LISTED] + more) or "no messages") + "."


def _by_name(recording: Recording, kind: str, name: str) -> Sensor:
    for sensor in recording.sensors:
        if sensor.kind == kind and sensor.name == name:
            return sensor
    what = "LiDAR" if kind == "lidar" else "camera"
    raise ReadError(
        "topic_not_found",
        f"There is no {what} topic {name!r} in the recording. {_contents(recording)}",
        "Choose one of these topics in the rig, or when uploading.",
        {"candidates": candidates([s for s in recording.sensors if s.kind == kind])},
    )


def _lidar(recording: Recording, name: str | None) -> Sensor:
    if name is not None:
        return _by_name(recording, "lidar", name)
    clouds = [s for s in recording.sensors if s.kind == "lidar" and s.count != 0]
    if not clouds:
        packets = {topic: maker_of_topic(topic) for topic in recording.other_topics}
        makers = sorted({maker for maker in packets.values() if maker is not None})
        if makers:
            named = ", ".join([topic for topic, maker in packets.items() if maker is not None][:_MOST_LISTED])
            raise ReadError(
                "lidar_packets_not_read",
                f"The recording holds packets of a LiDAR by {' and '.join(makers)} that cannot be read: {named}.",
                instead(makers),
                {"candidates": []},
            )
        raise ReadError(
            "no_lidar_topic",
            f"No LiDAR was found in the recording. {_contents(recording)}",
            "Record the LiDAR's points or packets (point cloud messages, a capture of its packets, or cloud files) "
            "together with the camera.",
            {"candidates": []},
        )
    best = _best_clouds(clouds)
    if len(best) > 1:
        raise ReadError(
            "ambiguous_lidar",
            f"{len(best)} topics could be the LiDAR: {', '.join(s.name for s in best[:_MOST_LISTED])}.",
            "Name the LiDAR's topic in the rig, or when uploading.",
            {"candidates": candidates(best)},
        )
    return best[0]


def _best_clouds(clouds: Sequence[Sensor]) -> list[Sensor]:
    """Return the topics that a driver publishes. Rings count first, then names, and of one sensor's topics times."""
    ringed = [s for s in clouds if "ring" in meanings(_fields(s))] or list(clouds)
    primary_topics = primary(ringed)
    if len({(s.frame_id, s.count) for s in primary_topics}) == 1 and primary_topics[0].frame_id:
        timed = [s for s in primary_topics if "time" in meanings(_fields(s))]
        return timed if len(timed) == 1 else primary_topics
    return primary_topics


def _fields(sensor: Sensor) -> list[str]:
    return sensor.notes.get("fields", "").split()


def _cameras(
    recording: Recording, topics: Sequence[Sensor], rig_topics: Mapping[str, str | None], sizes: Sizes
) -> dict[str, Sensor]:
    chosen = {name: _by_name(recording, "camera", topic) for name, topic in rig_topics.items() if topic is not None}
    open_names = [name for name, topic in rig_topics.items() if topic is None]
    taken = {sensor.name for sensor in chosen.values()}
    free = [topic for topic in primary(topics) if topic.name not in taken]
    if len(free) < len(open_names):  # rather a derived topic than none
        free = [topic for topic in topics if topic.name not in taken]
    fields = {"candidates": candidates(free), "cameras": open_names}
    if len(free) < len(open_names):
        raise ReadError(
            "ambiguous_cameras" if topics else "no_camera_topic",
            f"The rig has {len(rig_topics)} cameras; the recording has topics for {len(free) + len(taken)}. "
            f"{_contents(recording)}",
            "Record every camera of the rig (images, compressed or raw, or a video), or leave a camera out.",
            fields,
        )
    guessed = guess_cameras(open_names, free, sizes)
    missing = [name for name in open_names if name not in guessed]
    if missing:
        guessed_topics = {sensor.name for sensor in guessed.values()}
        raise ReadError(
            "ambiguous_cameras",
            f"Which topic belongs to which camera is not clear: cameras {', '.join(missing)}; "
            f"topics {', '.join(t.name for t in free[:_MOST_LISTED] if t.name not in guessed_topics)}.",
            "Name each camera's topic in the rig, or when uploading.",
            fields,
        )
    chosen |= guessed
    return {name: chosen[name] for name in rig_topics}
