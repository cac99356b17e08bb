"""Idempotency keys, entity tags and pages, through routes that use them."""

from concurrent.futures import ThreadPoolExecutor

import pytest
from sqlalchemy import delete, func, select, update

from service.platform.auth.credential_actions import new_secret, secret_hash
from service.platform.db.fleets import Fleet, Vehicle
from service.platform.db.people import ApiToken, IdempotencyKey, Membership
from tests.support.people import Actor, Api
from tests.support.uploads import RIG

KEY = {"Idempotency-Key": "7f3c"}


def count(api: Api, model) -> int:
    with api.database.reading() as session:
        return session.scalar(select(func.count()).select_from(model))


def test_a_repeated_post_gets_the_first_answer(api: Api) -> None:
    owner = api.owner()
    first = owner.post("/fleets", {"name": "north"}, headers=KEY)
    again = owner.post("/fleets", {"name": "north"}, headers=KEY)
    assert (first.status_code, again.status_code) == (201, 201)
    assert first.json() == again.json() and again.headers["idempotency-replayed"] == "true"
    assert count(api, Fleet) == 1


def test_a_key_belongs_to_one_request_of_one_person(api: Api) -> None:
    owner, other = api.owner(), api.owner()
    owner.post("/fleets", {"name": "north"}, headers=KEY)
    reused = owner.post("/fleets", {"name": "south"}, headers=KEY)
    assert (reused.status_code, reused.json()["code"]) == (422, "idempotency_key_reused")
    assert other.post("/fleets", {"name": "south"}, headers=KEY).status_code == 201


def test_a_refused_request_keeps_no_answer(api: Api) -> None:
    owner = api.owner()
    owner.post("/fleets", {"name": "north"})
    refused = owner.post("/fleets", {"name": "north"}, headers=KEY)
    assert (refused.status_code, refused.json()["code"]) == (409, "name_taken")
    assert count(api, IdempotencyKey) == 0
    assert owner.post("/fleets", {"name": "south"}, headers=KEY).status_code == 201


def test_twins_at_the_same_moment_make_one_thing(api: Api) -> None:
    fleet = api.fleet()
    engineer = api.member(fleet, "engineer")
    with ThreadPoolExecutor(6) as pool:
        answers = list(
            pool.map(lambda _: engineer.post(f"/fleets/{fleet}/vehicles", {"name": "van"}, headers=KEY), range(6))
        )
    assert {answer.status_code for answer in answers} == {201}
    assert len({answer.text for answer in answers}) == 1
    assert count(api, Vehicle) == 1


@pytest.mark.parametrize("key", ["k" * 201, "", "a\x00"])
def test_a_key_has_a_sensible_form(api: Api, key: str) -> None:
    answer = api.owner().post("/fleets", {"name": "n"}, headers={"Idempotency-Key": key})
    assert (answer.status_code, answer.json()["code"]) == (422, "invalid_request")


def test_reads_are_conditional_and_edits_name_their_version(api: Api) -> None:
    engineer = api.member(api.fleet("north"), "engineer")
    fleet = engineer.get("/fleets").json()["items"][0]["id"]
    van = f"/vehicles/{engineer.post(f'/fleets/{fleet}/vehicles', {'name': 'old'}).json()['id']}"
    tag = engineer.get(van).headers["etag"]
    assert tag == '"v1"'
    same = engineer.get(van, headers={"If-None-Match": f'"v0", W/{tag}'})
    assert (same.status_code, same.content, same.headers["etag"]) == (304, b"", tag)
    blind = engineer.patch(van, {"name": "new"})
    assert (blind.status_code, blind.json()["code"]) == (428, "if_match_required")
    edited = engineer.patch(van, {"name": "new"}, headers={"If-Match": tag})
    assert (edited.status_code, edited.headers["etag"], edited.json()["name"]) == (200, '"v2"', "new")
    late = engineer.patch(van, {"name": "newer"}, headers={"If-Match": tag})
    assert (late.status_code, late.json()["code"]) == (412, "version_conflict")
    assert engineer.get(van, headers={"If-None-Match": tag}).json()["name"] == "new"


def test_of_two_edits_of_one_version_one_wins(api: Api) -> None:
    fleet = api.fleet("north")
    owner = api.owner()
    with ThreadPoolExecutor(4) as pool:
        answers = list(
            pool.map(
                lambda number: owner.patch(f"/fleets/{fleet}", {"name": f"n{number}"}, headers={"If-Match": '"v1"'}),
                range(4),
            )
        )
    assert sorted(answer.status_code for answer in answers) == [200, 412, 412, 412]


@pytest.mark.parametrize(("total", "limit"), [(0, 3), (3, 3), (7, 3), (7, 100)])
def test_pages_hold_everything_once_and_in_order(api: Api, total: int, limit: int) -> None:
    fleet = api.fleet()
    engineer = api.member(fleet, "engineer")
    names = [f"van {number}" for number in range(total)]
    for name in names:
        engineer.post(f"/fleets/{fleet}/vehicles", {"name": name})
    found, after, pages = [], None, 0
    while True:
        params = {"limit": limit} | ({"after": after} if after else {})
        page = engineer.get(f"/fleets/{fleet}/vehicles", params=params).json()
        found += [one["name"] for one in page["items"]]
        after, pages = page["next"], pages + 1
        if after is None:
            break
    assert found == names and pages == max(1, -(-total // limit))


@pytest.mark.parametrize("after", ["x", "'; DROP TABLE fleet", "12", "0" * 200, "9" * 40])
def test_strange_cursors_are_refused(api: Api, after: str) -> None:
    answer = api.owner().get("/fleets", params={"after": after})
    assert (answer.status_code, answer.json()["code"]) == (422, "invalid_cursor")
    jobs = api.owner().get("/jobs", params={"after": "9" * 40})
    assert (jobs.status_code, jobs.json()["code"]) == (422, "invalid_cursor")


def test_an_answer_is_repeated_to_the_same_credential_only(api: Api) -> None:
    one, two = api.fleet(), api.fleet()
    engineer = api.member(one, "engineer")
    assert engineer.post(f"/fleets/{one}/vehicles", {"name": "secret car"}, headers=KEY).status_code == 201
    secret = new_secret("apx_")
    with api.database.writing() as session:
        session.add(Membership(person_id=engineer.person_id, fleet_id=two, role="viewer"))
        token = ApiToken(secret_hash=secret_hash(secret), name="b", person_id=engineer.person_id, fleet_id=two)
        session.add(token)
    elsewhere = Actor(engineer.person_id, secret, api.client)
    refused = elsewhere.post(f"/fleets/{one}/vehicles", {"name": "secret car"}, headers=KEY)
    assert (refused.status_code, refused.json()["code"]) == (422, "idempotency_key_reused")
    assert elsewhere.post(f"/fleets/{one}/vehicles", {"name": "secret car"}).status_code == 404


def test_an_answer_is_not_repeated_to_who_lost_the_role_or_the_fleet(api: Api) -> None:
    fleet = api.fleet()
    engineer = api.member(fleet, "engineer")
    vehicle = engineer.post(f"/fleets/{fleet}/vehicles", {"name": "van"}, headers=KEY)
    rigs = f"/vehicles/{vehicle.json()['id']}/rigs"
    assert engineer.post(rigs, RIG, headers={"Idempotency-Key": rigs}).status_code == 201
    again = engineer.post(f"/fleets/{fleet}/vehicles", {"name": "van"}, headers=KEY)
    assert again.headers["idempotency-replayed"] == "true"
    lost = update(Membership).where(Membership.person_id == engineer.person_id)
    with api.database.writing() as session:
        session.execute(lost.values(role="viewer"))
    for path, body, key in (
        (f"/fleets/{fleet}/vehicles", {"name": "van"}, KEY),
        (rigs, RIG, {"Idempotency-Key": rigs}),
    ):
        refused = engineer.post(path, body, headers=key)
        assert (refused.status_code, refused.json()["code"]) == (403, "role_too_low")
    with api.database.writing() as session:
        session.execute(delete(Membership).where(Membership.person_id == engineer.person_id))
    refused = engineer.post(f"/fleets/{fleet}/vehicles", {"name": "van"}, headers=KEY)
    assert (refused.status_code, refused.json()["code"]) == (404, "not_found")
