"""Invitations, members and tokens: nobody hands out more than they have."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta
from typing import Any

import pytest
from sqlalchemy import select, update

from service.platform.db.clock import utc_now
from service.platform.db.people import ApiToken, IdempotencyKey, Membership
from tests.support.databases import wait_until_one_waits
from tests.support.people import Actor, Api


@pytest.mark.parametrize(
    ("inviter", "role", "status"),
    [
        ("engineer", "viewer", 201),
        ("engineer", "reviewer", 201),
        ("engineer", "engineer", 403),
        ("engineer", "admin", 403),
        ("admin", "admin", 201),
        ("reviewer", "viewer", 403),
    ],
)
def test_who_may_invite_whom(api: Api, inviter: str, role: str, status: int) -> None:
    fleet = api.fleet()
    answer = api.member(fleet, inviter).post(f"/fleets/{fleet}/invitations", {"name": "Bo", "role": role})
    assert answer.status_code == status, answer.text
    if status == 201:
        me = api.client.post("/v1/sign-in", json={"link": answer.json()["link"]}).json()
        assert me["name"] == "Bo" and me["fleets"] == [{"id": str(fleet), "name": "fleet 1", "role": role}]


def test_a_member_gets_another_link_and_stays_the_same_person(api: Api) -> None:
    fleet = api.fleet()
    engineer, admin = api.member(fleet, "engineer"), api.member(fleet, "admin")
    first = engineer.post(f"/fleets/{fleet}/invitations", {"name": "Bo", "role": "annotator"}).json()
    body = {"name": "Bo", "role": "annotator", "person_id": first["person_id"]}
    refused = engineer.post(f"/fleets/{fleet}/invitations", body)
    assert (refused.status_code, refused.json()["code"]) == (403, "role_too_low")
    second = admin.post(f"/fleets/{fleet}/invitations", body)
    assert second.status_code == 201 and second.json()["person_id"] == first["person_id"]
    assert second.json()["link"] != first["link"]


def test_a_link_never_makes_somebody_greater(api: Api) -> None:
    fleet, other = api.fleet(), api.fleet()
    engineer, admin, owner = api.member(fleet, "engineer"), api.member(fleet, "admin"), api.owner()
    elsewhere = api.member(fleet, "viewer")
    with api.database.writing() as session:
        session.add(Membership(person_id=elsewhere.person_id, fleet_id=other, role="admin"))
        session.add(Membership(person_id=owner.person_id, fleet_id=fleet, role="viewer"))
    for actor, target in ((engineer, admin), (admin, elsewhere), (admin, owner)):
        body = {"name": "x", "role": "viewer", "person_id": str(target.person_id)}
        answer = actor.post(f"/fleets/{fleet}/invitations", body)
        assert (answer.status_code, answer.json()["code"]) == (403, "role_too_low")
    stranger = api.member(other, "viewer")
    body = {"name": "x", "role": "viewer", "person_id": str(stranger.person_id)}
    assert admin.post(f"/fleets/{fleet}/invitations", body).status_code == 404


def test_members_are_listed_changed_and_removed(api: Api) -> None:
    fleet = api.fleet()
    admin, viewer = api.member(fleet, "admin"), api.member(fleet, "viewer")
    names = {one["name"]: one["role"] for one in admin.get(f"/fleets/{fleet}/members").json()["items"]}
    assert names == {"admin": "admin", "viewer": "viewer"}
    path = f"/fleets/{fleet}/members/{viewer.person_id}"
    raised = admin.patch(path, {"role": "engineer"}).json()
    assert (raised["role"], raised["ended"]) == ("engineer", {"sessions": 0, "links": 0, "tokens": 1})
    assert viewer.get("/me").status_code == 401
    lowered = admin.patch(path, {"role": "annotator"}).json()
    assert (lowered["role"], lowered["ended"]) == ("annotator", None)
    assert admin.delete(path).status_code == 204
    assert admin.delete(path).status_code == 404


def test_a_fleet_keeps_an_admin(api: Api) -> None:
    fleet = api.fleet()
    admin, other, owner = api.member(fleet, "admin", "Ada"), api.member(fleet, "engineer"), api.owner()
    mine, theirs = (f"/fleets/{fleet}/members/{who.person_id}" for who in (admin, other))
    for answer in (admin.delete(mine), admin.patch(mine, {"role": "engineer"})):
        assert (answer.status_code, answer.json()["code"]) == (409, "last_admin") and "Ada" in answer.text
    assert admin.patch(mine, {"role": "admin"}).status_code == 200
    assert admin.patch(theirs, {"role": "admin"}).status_code == 200
    assert admin.patch(mine, {"role": "engineer"}).status_code == 200, "there is another"
    assert owner.delete(theirs).status_code == 204, "who may appoint an admin again"


@pytest.mark.parametrize("step_down", [Actor.delete, lambda who, path: who.patch(path, {"role": "viewer"})])
def test_of_two_admins_who_leave_at_once_one_stays(api: Api, step_down: Callable[[Actor, str], Any]) -> None:
    fleet = api.fleet()
    admins = [api.member(fleet, "admin") for _ in range(2)]
    with ThreadPoolExecutor(2) as pool:
        with api.database.writing() as session:
            session.execute(select(Membership.role).where(Membership.fleet_id == fleet).with_for_update()).all()
            left = [pool.submit(step_down, who, f"/fleets/{fleet}/members/{who.person_id}") for who in admins]
            wait_until_one_waits(api.database)
        statuses = sorted(answer.result().status_code for answer in left)
    assert statuses in ([200, 409], [204, 409])


def test_a_token_is_bound_to_its_fleet_and_role(api: Api) -> None:
    fleet, other = api.fleet(), api.fleet()
    owner = api.owner()
    made = owner.post(f"/fleets/{fleet}/tokens", {"name": "robot", "role": "viewer"}).json()
    assert made["token"].startswith("apx_")
    robot = type(owner)(owner.person_id, made["token"], api.client)
    assert [one["role"] for one in robot.get("/me").json()["fleets"]] == ["viewer"]
    assert robot.get("/me").json()["is_owner"] is False
    assert robot.get(f"/fleets/{other}").status_code == 404
    assert robot.post(f"/fleets/{fleet}/vehicles", {"name": "v"}).json()["code"] == "role_too_low"
    assert robot.post("/fleets", {"name": "mine"}).json()["code"] == "owner_only"
    assert [one["id"] for one in robot.get("/fleets").json()["items"]] == [str(fleet)]
    assert owner.delete(f"/tokens/{made['id']}").status_code == 204
    assert robot.get("/me").status_code == 401
    assert owner.get(f"/tokens/{made['id']}").json()["revoked_at"] is not None


def test_tokens_end_and_follow_their_makers_role(api: Api) -> None:
    fleet = api.fleet()
    engineer, admin = api.member(fleet, "engineer"), api.member(fleet, "admin")
    assert engineer.post(f"/fleets/{fleet}/tokens", {"name": "t", "role": "admin"}).status_code == 403
    made = engineer.post(f"/fleets/{fleet}/tokens", {"name": "t", "role": "engineer", "expires_in_days": 1}).json()
    robot = type(engineer)(engineer.person_id, made["token"], api.client)
    admin.patch(f"/fleets/{fleet}/members/{engineer.person_id}", {"role": "annotator"})
    assert robot.get("/me").json()["fleets"][0]["role"] == "annotator"
    with api.database.writing() as session:
        session.execute(update(ApiToken).values(expires_at=utc_now() - timedelta(seconds=1)))
    assert robot.get("/me").status_code == 401


def test_engineers_see_their_own_tokens_admins_all(api: Api) -> None:
    fleet = api.fleet()
    one, two, admin = api.member(fleet, "engineer"), api.member(fleet, "engineer"), api.member(fleet, "admin")
    made = one.post(f"/fleets/{fleet}/tokens", {"name": "t", "role": "viewer"}).json()
    assert [len(who.get(f"/fleets/{fleet}/tokens").json()["items"]) for who in (one, two, admin)] == [1, 0, 1]
    assert two.get(f"/tokens/{made['id']}").status_code == 404
    assert two.delete(f"/tokens/{made['id']}").status_code == 404
    assert "token" not in one.get(f"/tokens/{made['id']}").json()


def test_a_repeated_invitation_makes_nothing_and_its_link_is_stored_nowhere(api: Api) -> None:
    fleet = api.fleet()
    engineer = api.member(fleet, "engineer")
    ask = {"json": {"name": "Bo Ek", "role": "viewer"}, "headers": {"Idempotency-Key": "once"}}
    first = engineer.post(f"/fleets/{fleet}/invitations", **ask)
    assert (first.status_code, first.headers["cache-control"]) == (201, "no-store")
    members = len(engineer.get(f"/fleets/{fleet}/members").json()["items"])
    again = engineer.post(f"/fleets/{fleet}/invitations", **ask)
    assert (again.status_code, again.json()["code"]) == (409, "answer_not_kept")
    assert len(engineer.get(f"/fleets/{fleet}/members").json()["items"]) == members
    with api.database.reading() as session:
        assert session.scalars(select(IdempotencyKey.body)).one() is None
    other = engineer.post(f"/fleets/{fleet}/tokens", {"name": "t", "role": "engineer"}).json()["token"]
    elsewhere = type(engineer)(engineer.person_id, other, api.client)
    refused = elsewhere.post(f"/fleets/{fleet}/invitations", **ask)
    assert (refused.status_code, refused.json()["code"]) == (422, "idempotency_key_reused")
