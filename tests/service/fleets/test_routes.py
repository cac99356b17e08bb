"""Fleets, vehicles and rigs."""

import copy
import math

import pytest

from service.platform.db.models import Vehicle
from tests.support.people import Api
from tests.support.uploads import RIG, new_vehicle


def test_only_owners_make_fleets_and_see_all(api: Api) -> None:
    owner = api.owner()
    north = owner.post("/fleets", {"name": "north"}).json()
    assert north["role"] == "admin"
    api.fleet("south")
    assert [one["name"] for one in owner.get("/fleets").json()["items"]] == ["north", "south"]
    west = api.fleet("west")
    admin = api.member(west, "admin")
    refused = admin.post("/fleets", {"name": "mine"})
    assert (refused.status_code, refused.json()["code"]) == (403, "owner_only")
    # Neither a name that is free nor one that is taken tells of fleets of others.
    for name in ("south", "nobody's"):
        refused = admin.patch(f"/fleets/{west}", {"name": name}, headers={"If-Match": '"v1"'})
        assert (refused.status_code, refused.json()["code"]) == (403, "owner_only")
    taken = owner.patch(f"/fleets/{west}", {"name": "south"}, headers={"If-Match": '"v1"'})
    assert taken.json()["code"] == "name_taken"
    assert [one["name"] for one in admin.get("/fleets").json()["items"]] == ["west"]


def test_names_are_taken_once(api: Api) -> None:
    fleet = api.fleet("north")
    engineer = api.member(fleet, "engineer")
    made = new_vehicle(engineer, fleet)
    again = engineer.post(f"/fleets/{fleet}/vehicles", {"name": " van "})
    assert (again.status_code, again.json()["code"]) == (409, "name_taken")
    again = engineer.post(f"/vehicles/{made['vehicle']}/rigs", RIG)
    assert (again.status_code, again.json()["code"]) == (409, "name_taken")
    other = engineer.post(f"/fleets/{fleet}/vehicles", {"name": "bus"}).json()
    renamed = engineer.patch(f"/vehicles/{other['id']}", {"name": "van"}, headers={"If-Match": '"v1"'})
    assert renamed.json()["code"] == "name_taken"
    renamed = engineer.patch(f"/vehicles/{other['id']}", {"name": "truck"}, headers={"If-Match": '"v1"'})
    assert renamed.json()["name"] == "truck" and renamed.json()["version"] == 2


def test_a_rig_is_read_back_as_it_was_written(api: Api) -> None:
    fleet = api.fleet()
    engineer = api.member(fleet, "engineer")
    vehicle = new_vehicle(engineer, fleet)["vehicle"]
    rig = copy.deepcopy(RIG) | {"name": "other"}
    rig["T_vehicle_lidar"] = {
        "to_frame": "base_link",
        "from_frame": "velodyne",
        "rotation": {"quaternion_xyzw": [0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)]},
        "translation_m": [1.0, 0.0, 1.8],
    }
    rig["cameras"][0]["bounds"] = {"f_x": [900.0, 1300.0], "beta_deg": [-110.0, -70.0], "k1": [-0.5, 0.5]}
    made = engineer.post(f"/vehicles/{vehicle}/rigs", rig)
    assert made.status_code == 201, made.text
    got = engineer.get(f"/rigs/{made.json()['id']}").json()
    assert got == made.json()
    assert got["T_vehicle_lidar"] == rig["T_vehicle_lidar"]
    assert got["cameras"][0] == rig["cameras"][0] | {"topic": None, "serial": None, "joint": None, "images": None}
    listed = engineer.get(f"/vehicles/{vehicle}/rigs").json()["items"]
    assert [one["name"] for one in listed] == ["roof", "other"] and listed[1] == got


def camera(**changed) -> dict:
    rig = copy.deepcopy(RIG)
    rig["cameras"][0] |= changed
    return rig


def nominal(**changed) -> dict:
    return camera(nominal=RIG["cameras"][0]["nominal"] | changed)


def rotation(**form) -> dict:
    return nominal(rotation=form)


@pytest.mark.parametrize(
    ("rig", "says"),
    [
        (nominal(to_frame="velodyne", from_frame="camera_front_optical"), "inverted"),
        (nominal(to_frame="camera_left_optical"), "maps points of 'velodyne' into 'camera_front_optical'"),
        (nominal(translation_m=[0.0, 0.0, 2000.0]), "1000"),
        (nominal(translation_m=[0.0, 0.0]), "required"),
        (rotation(angles_deg=[90, -90, 0]), "the order is never assumed"),
        (rotation(euler_order="xyz", angles_deg=[90, -90, 0]), "zyx"),
        (rotation(matrix=[[1, 0, 0], [0, 1, 0], [0, 0, -1]]), "mirrors"),
        (rotation(matrix=[[2, 0, 0], [0, 2, 0], [0, 0, 2]]), "orthonormal"),
        (rotation(quaternion_xyzw=[1, 1, 0, 0]), "unit length"),
        (rotation(matrix=[[1, 0, 0], [0, 1, 0], [0, 0, 1]], quaternion_xyzw=[0, 0, 0, 1]), "exactly one form"),
        (rotation(), "exactly one form"),
        (camera(bounds={"f_x": [5.0, 4.0]}), "inside out"),
        (camera(bounds={"fx": [4.0, 5.0]}), "no parameter 'fx'"),
        (camera(bounds={"f_x": [4.0, 1e200]}), "less than or equal to 1000000"),
        (camera(image_size=[0, 720]), "16"),
        (camera(name="front/left"), "pattern"),
        (RIG | {"cameras": []}, "at least 1"),
        (RIG | {"cameras": RIG["cameras"] * 2}, "its own name"),
    ],
)
def test_what_cannot_be_a_rig_is_explained(api: Api, rig: dict, says: str) -> None:
    fleet = api.fleet()
    engineer = api.member(fleet, "engineer")
    vehicle = engineer.post(f"/fleets/{fleet}/vehicles", {"name": "van"}).json()["id"]
    answer = engineer.post(f"/vehicles/{vehicle}/rigs", rig)
    assert (answer.status_code, answer.json()["code"]) == (422, "invalid_request")
    assert says in answer.text


@pytest.mark.parametrize("database_url", ["postgresql"], indirect=True)
def test_a_vehicle_is_made_beside_a_long_transaction_that_inserts_rows_of_the_fleet(api: Api) -> None:
    """Such as a part of a fleet request; SQLite has one writer."""
    fleet = api.fleet()
    engineer = api.member(fleet, "engineer")
    with api.database.writing() as session:
        session.add(Vehicle(fleet_id=fleet, name="slow", version=1))
        session.flush()
        made = engineer.post(f"/fleets/{fleet}/vehicles", {"name": "quick"})
        assert made.status_code == 201, made.text
