"""Which rigs a recording that was read may have."""

from __future__ import annotations

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.platform.db.fleets import Rig
from service.platform.db.recordings import Recording, Sensor
from service.platform.http.problems import Problem


def require_same_sensors(session: Session, recording: Recording, rig: Rig) -> None:
    """Raise :class:`Problem` 409 ``sensors_differ`` unless the recording was read as this rig would have it read."""
    rows = {row.name: row for row in session.scalars(select(Sensor).where(Sensor.recording_id == recording.id))}
    topics = {"lidar": rig.lidar_topic} | {camera.name: camera.topic for camera in rig.cameras}
    sizes = {camera.name: (camera.image_width, camera.image_height) for camera in rig.cameras}
    for name, topic in topics.items():
        row = rows.get(name)
        if row is None:
            raise _differ(f"The recording has no {name!r}: its sensors are {', '.join(sorted(rows))}.")
        if topic is not None and topic != row.topic:
            raise _differ(f"{name} was read from {row.topic}, and the rig says {topic}.")
        size = (row.facts.get("width"), row.facts.get("height"))
        if name in sizes and sizes[name] != size:
            raise _differ(f"Images of {name} have {size[0]} x {size[1]} pixels, and the rig says {sizes[name]}.")


def _differ(what: str) -> Problem:
    return Problem(409, "sensors_differ", what, "Correct the new rig, or upload the recording again with it.")
