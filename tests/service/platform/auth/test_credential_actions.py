"""No link, session or token outlives what made it, or rises with its person."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any
from uuid import UUID

import pytest
from sqlalchemy import update

from service.platform.auth.bootstrap import owner as first_owner
from service.platform.auth.bootstrap import renew_owner_token
from service.platform.auth.credential_actions import end_credentials, revoke
from service.platform.auth.session_actions import make_link, sign_in
from service.platform.db.people import ApiToken, Membership
from tests.support.databases import wait_until_one_waits
from tests.support.people import Actor, Api

ORIGIN = {"Origin": "http://127.0.0.1:8000"}


def link_of(api: Api, person_id: UUID) -> str:
    with api.database.writing() as session:
        return make_link(session, person_id, "http://127.0.0.1:8000", 1)[0]


def signed_in(api: Api, link: str) -> dict[str, str]:
    """The headers of a browser that opened the link."""
    cookie = api.client.post("/v1/sign-in", json={"link": link}).cookies["apexcal_session"]
    api.client.cookies.clear()
    return {"Cookie": f"apexcal_session={cookie}", **ORIGIN}


def status(api: Api, headers: dict[str, str]) -> int:
    return api.client.get("/v1/me", headers=headers).status_code


def token_of(api: Api, actor: Actor, fleet: UUID, role: str = "viewer") -> Actor:
    made = actor.post(f"/fleets/{fleet}/tokens", {"name": "robot", "role": role})
    assert made.status_code == 201, made.text
    return Actor(actor.person_id, made.json()["token"], api.client)


def test_raising_somebody_ends_what_let_them_in(api: Api) -> None:
    fleet, other = api.fleet(), api.fleet()
    engineer, admin = api.member(fleet, "engineer"), api.member(fleet, "admin")
    # The attack of the report: the engineer keeps a copy of what lets Bo in, and waits until Bo is promoted.
    kept = engineer.post(f"/fleets/{fleet}/invitations", {"name": "Bo", "role": "reviewer"}).json()
    bo = UUID(kept["person_id"])
    with api.database.writing() as session:
        session.add(Membership(person_id=bo, fleet_id=other, role="engineer"))
    session_of_bo = signed_in(api, link_of(api, bo))
    made = api.client.post(f"/v1/fleets/{other}/tokens", json={"name": "t", "role": "viewer"}, headers=session_of_bo)
    elsewhere = {"Authorization": f"Bearer {made.json()['token']}"}
    raised = admin.patch(f"/fleets/{fleet}/members/{bo}", {"role": "admin"}).json()
    assert raised["ended"] == {"sessions": 1, "links": 1, "tokens": 0}
    late = api.client.post("/v1/sign-in", json={"link": kept["link"]})
    assert (late.status_code, late.json()["code"]) == (410, "link_expired")
    assert status(api, session_of_bo) == 401
    assert status(api, elsewhere) == 200, "a token of another fleet has nothing to do with it"
    # An admin's word brings the person in again, in the new role; of every fleet, for a link opens all of them.
    again = {"name": "Bo", "role": "admin", "person_id": str(bo)}
    assert admin.post(f"/fleets/{fleet}/invitations", again).status_code == 403
    link = api.owner().post(f"/fleets/{fleet}/invitations", again).json()["link"]
    assert status(api, signed_in(api, link)) == 200


@pytest.mark.parametrize(("old", "new"), [("admin", "viewer"), ("viewer", "viewer")])
def test_who_is_not_raised_stays_signed_in(api: Api, old: str, new: str) -> None:
    fleet = api.fleet()
    admin, bo = api.member(fleet, "admin"), api.member(fleet, old)
    headers = signed_in(api, link_of(api, bo.person_id))
    assert admin.patch(f"/fleets/{fleet}/members/{bo.person_id}", {"role": new}).json()["ended"] is None
    assert status(api, headers) == 200 and bo.get("/me").status_code == 200


def test_an_owner_cannot_be_raised(api: Api) -> None:
    fleet = api.fleet()
    owner = api.owner()
    with api.database.writing() as session:
        session.add(Membership(person_id=owner.person_id, fleet_id=fleet, role="viewer"))
    admin = api.member(fleet, "admin")
    assert admin.patch(f"/fleets/{fleet}/members/{owner.person_id}", {"role": "admin"}).json()["ended"] is None
    assert owner.get("/me").status_code == 200


def test_a_token_hands_out_nothing(api: Api) -> None:
    fleet = api.fleet()
    admin, bo = api.member(fleet, "admin"), api.member(fleet, "viewer")
    robot = token_of(api, admin, fleet, "admin")
    for method, path, body in (
        ("POST", "tokens", {"name": "child", "role": "viewer"}),
        ("POST", "invitations", {"name": "Cy", "role": "viewer"}),
        ("POST", "invitations", {"name": "Bo", "role": "viewer", "person_id": str(bo.person_id)}),
        ("PATCH", f"members/{bo.person_id}", {"role": "admin"}),
    ):
        answer = robot.request(method, f"/fleets/{fleet}/{path}", json=body)
        assert (answer.status_code, answer.json()["code"]) == (403, "token_gives_nothing"), path
    assert len(admin.get(f"/fleets/{fleet}/members").json()["items"]) == 2


@pytest.fixture
def machine(api: Api) -> Callable[[], Actor]:
    """The owner by the token that lies on the service's machine, renewed with each call as at each start."""

    def renewed() -> Actor:
        with api.database.writing() as session:
            person = first_owner(session)
            return Actor(person.id, renew_owner_token(session, person), api.client)

    return renewed


def test_what_the_machines_token_made_ends_with_it_and_not_at_a_restart(api: Api, machine) -> None:
    fleet = api.fleet()
    owner = machine()
    robot = token_of(api, owner, fleet, "engineer")
    invite = {"name": "Bo", "role": "viewer"}
    bo = signed_in(api, owner.post(f"/fleets/{fleet}/invitations", invite).json()["link"])
    unused = owner.post(f"/fleets/{fleet}/invitations", invite).json()["link"]
    machine()
    refused = owner.post(f"/fleets/{fleet}/tokens", {"name": "late", "role": "viewer"})
    assert (refused.status_code, refused.json()["code"]) == (403, "token_gives_nothing"), "it ends in a minute"
    assert (robot.get("/me").status_code, status(api, bo)) == (200, 200)
    with api.database.writing() as session:
        made = revoke(session, ApiToken.fleet_id.is_(None))
    assert (made.sessions, made.links) == (1, 1)
    assert (robot.get("/me").status_code, status(api, bo)) == (401, 401)
    assert api.client.post("/v1/sign-in", json={"link": unused}).json()["code"] == "link_expired"


def beside(api: Api, change: Callable[[Any], Any], ask: Callable[[], Any]) -> Any:
    """What ``ask`` is answered that came while ``change`` was made and not yet committed."""
    with ThreadPoolExecutor(1) as pool:
        with api.database.writing() as session:
            change(session)
            answer: Future[Any] = pool.submit(ask)
            wait_until_one_waits(api.database)
            assert not answer.done(), "it waits for the change"
        return answer.result(30)


def test_a_link_that_is_used_while_its_person_is_raised_opens_nothing(api: Api) -> None:
    fleet = api.fleet()
    admin, bo = api.member(fleet, "admin"), api.member(fleet, "viewer")
    link = link_of(api, bo.person_id)
    secrets = []
    raised = beside(
        api,
        lambda session: secrets.append(sign_in(session, link, 1)[1]),
        lambda: admin.patch(f"/fleets/{fleet}/members/{bo.person_id}", {"role": "admin"}),
    )
    assert raised.json()["ended"]["sessions"] == 1
    assert status(api, {"Cookie": f"apexcal_session={secrets[0]}"}) == 401


def raise_to(api: Api, fleet: UUID, person_id: UUID, role: str) -> Callable[[Any], None]:
    def change(session: Any) -> None:
        end_credentials(session, person_id, fleet)
        where = (Membership.person_id == person_id, Membership.fleet_id == fleet)
        session.execute(update(Membership).where(*where).values(role=role))

    return change


def test_a_token_is_not_made_by_a_session_that_ends_meanwhile(api: Api) -> None:
    fleet = api.fleet()
    bo = api.member(fleet, "engineer")
    headers = signed_in(api, link_of(api, bo.person_id))
    body = {"name": "t", "role": "viewer"}
    answer = beside(
        api,
        raise_to(api, fleet, bo.person_id, "admin"),
        lambda: api.client.post(f"/v1/fleets/{fleet}/tokens", json=body, headers=headers),
    )
    assert (answer.status_code, answer.json()["code"]) == (401, "not_signed_in")


def test_a_link_is_not_made_for_somebody_who_is_raised_elsewhere_meanwhile(api: Api) -> None:
    here, there = api.fleet(), api.fleet()
    admin, bo = api.member(here, "admin"), api.member(here, "viewer")
    with api.database.writing() as session:
        session.add(Membership(person_id=admin.person_id, fleet_id=there, role="admin"))
        session.add(Membership(person_id=bo.person_id, fleet_id=there, role="viewer"))

    def change(session: Any) -> None:
        raise_to(api, there, bo.person_id, "admin")(session)
        lost = (Membership.person_id == admin.person_id, Membership.fleet_id == there)
        session.execute(update(Membership).where(*lost).values(role="engineer"))

    body = {"name": "Bo", "role": "viewer", "person_id": str(bo.person_id)}
    answer = beside(api, change, lambda: admin.post(f"/fleets/{here}/invitations", body))
    assert (answer.status_code, answer.json()["code"]) == (403, "role_too_low")
