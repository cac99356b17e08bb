"""Uploading as a client does."""

import hashlib
from base64 import b64encode
from typing import Any

from sqlalchemy import select

from service.platform.db.recordings import Blob
from tests.support.people import Actor, Api

RIG = {
    "name": "roof",
    "lidar": {"frame": "velodyne", "topic": None},
    "cameras": [
        {
            "name": "front",
            "frame": "camera_front_optical",
            "image_size": [1280, 720],
            "nominal": {
                "to_frame": "camera_front_optical",
                "from_frame": "velodyne",
                "rotation": {"euler_order": "zyx", "angles_deg": [90.0, -90.0, 0.0]},
                "translation_m": [0.0, -0.2, -0.1],
            },
        }
    ],
}


def digest(data: bytes) -> str:
    """The Content-Digest header of some bytes."""
    return f"sha-256=:{b64encode(hashlib.sha256(data).digest()).decode()}:"


def new_vehicle(actor: Actor, fleet_id: Any, name: str = "van") -> dict[str, Any]:
    """Make a vehicle with a rig; the answer is {"vehicle": id, "rig": id}."""
    vehicle = actor.post(f"/fleets/{fleet_id}/vehicles", {"name": name})
    assert vehicle.status_code == 201, vehicle.text
    rig = actor.post(f"/vehicles/{vehicle.json()['id']}/rigs", RIG)
    assert rig.status_code == 201, rig.text
    return {"vehicle": vehicle.json()["id"], "rig": rig.json()["id"]}


def new_recording(actor: Actor, fleet_id: Any, name: str = "drive", **more: Any) -> dict[str, Any]:
    """Make a vehicle, a rig and a recording that waits for its parts."""
    made = new_vehicle(actor, fleet_id, name=f"van of {name}")
    body = {"rig_id": made["rig"], "name": name, "file_name": f"{name}.bag", **more}
    recording = actor.post(f"/vehicles/{made['vehicle']}/recordings", body)
    assert recording.status_code == 201, recording.text
    return recording.json()


def put_part(actor: Actor, recording_id: Any, number: int, data: bytes, **headers: str) -> Any:
    """Send one part."""
    return actor.put(
        f"/recordings/{recording_id}/parts/{number}",
        content=data,
        headers={"Content-Digest": digest(data), "Content-Type": "application/octet-stream", **headers},
    )


def upload(actor: Actor, recording_id: Any, parts: list[bytes], **declared: Any) -> Any:
    """Send all parts and complete; the response of completing."""
    for number, data in enumerate(parts, 1):
        answer = put_part(actor, recording_id, number, data)
        assert answer.status_code == 200, answer.text
    body = {"parts": len(parts), "size": sum(map(len, parts)), "sha256": None, **declared}
    return actor.post(f"/recordings/{recording_id}/complete", body)


def blobs(api: Api) -> dict[str, int]:
    """How many blobs are in which state."""
    with api.database.reading() as session:
        states = session.scalars(select(Blob.state)).all()
    return {state: states.count(state) for state in set(states)}
