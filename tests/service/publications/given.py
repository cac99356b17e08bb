"""What the tests of publications, aliases, gates and serial numbers share: a vehicle with results to give it."""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import update

from service.platform.db.calibrations import CorrespondenceSet
from service.platform.db.fleets import Rig, RigCamera, RigLidar, Vehicle
from tests.service.calibrations.test_results import seed_results
from tests.support.rows import add, make


def publish(api, rig, reviewer, **body):
    """A new result, published; the answer."""
    _, (result, _) = seed_results(api, rig)
    made = reviewer.post(f"/results/{result}/publication", body or None)
    assert made.status_code == 201, made.text
    return made.json()


def withdraw(reviewer, publication, reason="It pulls to the left."):
    made = reviewer.post(f"/publications/{publication['id']}/withdrawal", {"reason": reason})
    assert made.status_code == 201, made.text
    return made.json()


def camera_address(rig, camera="front"):
    return f"/vehicles/{rig.vehicle_id}/cameras/{camera}"


def history(actor, rig, alias="current"):
    return actor.get(camera_address(rig) + "/publications", params={"alias": alias}).json()["items"]


def another_rig(api, rig, name, **changed):
    """A later rig of the same vehicle with the same camera; ``serial`` and ``lidar_serial`` of its sensors."""
    with api.database.writing() as session:
        vehicle = session.get_one(Vehicle, rig.vehicle_id)
        lidars = [make(RigLidar, serial=changed.get("lidar_serial"))]
        made = add(session, Rig, vehicle, name=name, lidars=lidars)
        add(session, RigCamera, made, serial=changed.get("serial"))
        return made


def same_moment(one: str, other: str) -> bool:
    """Whether two texts are the same moment: one route writes +00:00, another Z."""
    return datetime.fromisoformat(one) == datetime.fromisoformat(other)


def put_pairs(api, u, v):
    """Give every set these marks."""
    with api.database.writing() as session:
        session.execute(update(CorrespondenceSet).values(pairs={"u": u, "v": v}))
