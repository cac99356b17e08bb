"""Links sign in once; sessions are cookies; edits by cookie must come from our own pages."""

from datetime import timedelta

import pytest
from sqlalchemy import select, update

from service.platform.auth.bootstrap import main as bootstrap
from service.platform.auth.retention import remove_ended
from service.platform.auth.session_actions import make_link
from service.platform.db.clock import utc_now
from service.platform.db.people import ApiToken, BrowserSession, Person, SignInLink
from service.platform.settings import Settings
from tests.support.people import Api

ORIGIN = {"Origin": "http://127.0.0.1:8000"}


def link_for(api: Api, person_id, hours: int = 1) -> str:
    with api.database.writing() as session:
        return make_link(session, person_id, "http://127.0.0.1:8000", hours)[0]


@pytest.fixture
def person_id(api: Api):
    return api.member(api.fleet(), "engineer").person_id


def test_a_link_signs_in_once(api: Api, person_id) -> None:
    link = link_for(api, person_id)
    secret = link.split("#")[1]
    answer = api.client.post("/v1/sign-in", json={"link": secret})
    assert answer.status_code == 200
    cookie = answer.headers["set-cookie"]
    assert "HttpOnly" in cookie and "SameSite=strict" in cookie and "Secure" not in cookie
    me = api.client.get("/v1/me").json()
    assert me == answer.json() and me["id"] == str(person_id) and me["fleets"][0]["role"] == "engineer"
    again = api.client.post("/v1/sign-in", json={"link": link})
    assert (again.status_code, again.json()["code"]) == (410, "link_used")


def test_links_end_and_strange_ones_are_unknown(api: Api, person_id) -> None:
    late = api.client.post("/v1/sign-in", json={"link": link_for(api, person_id, hours=-1)})
    assert (late.status_code, late.json()["code"]) == (410, "link_expired")
    strange = api.client.post("/v1/sign-in", json={"link": "guessed"})
    assert (strange.status_code, strange.json()["code"]) == (404, "link_unknown")


def test_the_cookie_is_secure_behind_https(make_api) -> None:
    api = make_api(public_url="https://calibration.example")
    person = api.member(api.fleet(), "viewer")
    answer = api.client.post("/v1/sign-in", json={"link": link_for(api, person.person_id)})
    assert "Secure" in answer.headers["set-cookie"]


def test_signing_out_ends_the_session(api: Api, person_id) -> None:
    api.client.post("/v1/sign-in", json={"link": link_for(api, person_id)})
    assert api.client.post("/v1/sign-out", headers=ORIGIN).status_code == 204
    assert api.client.get("/v1/me").json()["code"] == "not_signed_in"
    with api.database.reading() as session:
        assert session.scalars(select(BrowserSession)).all() == []


def test_sessions_end(api: Api, person_id) -> None:
    api.client.post("/v1/sign-in", json={"link": link_for(api, person_id)})
    with api.database.writing() as session:
        session.execute(update(BrowserSession).values(expires_at=utc_now() - timedelta(seconds=1)))
    assert api.client.get("/v1/me").status_code == 401


@pytest.mark.parametrize(
    ("headers", "code"),
    [
        ({}, "origin_refused"),
        ({"Origin": "https://evil.example"}, "origin_refused"),
        ({"Origin": "null"}, "origin_refused"),
        ({"Origin": "http://127.0.0.1:5173"}, "origin_refused"),
        ({"Origin": "http://evil.example", "Host": "evil.example"}, "host_refused"),
        (ORIGIN, None),
        ({"Origin": "http://localhost:8000", "Host": "localhost:8000"}, None),
    ],
)
def test_edits_by_cookie_come_from_our_own_pages(api: Api, headers, code) -> None:
    fleet = api.fleet()
    person = api.member(fleet, "engineer")
    cookie = api.client.post("/v1/sign-in", json={"link": link_for(api, person.person_id)}).cookies
    sent = {**headers, "Cookie": f"apexcal_session={cookie['apexcal_session']}"}
    answer = api.client.post(f"/v1/fleets/{fleet}/vehicles", json={"name": "van"}, headers=sent)
    if code is None:
        assert answer.status_code == 201, answer.text
    else:
        assert (answer.status_code, answer.json()["code"]) == (403, code)
        assert api.client.get("/v1/me", headers=sent).status_code == 200


def test_no_secret_is_stored_as_it_is(api: Api, person_id) -> None:
    link = link_for(api, person_id).split("#")[1]
    cookie = api.client.post("/v1/sign-in", json={"link": link}).cookies["apexcal_session"]
    with api.database.reading() as session:
        kept = {
            *session.scalars(select(SignInLink.secret_hash)),
            *session.scalars(select(BrowserSession.secret_hash)),
            *session.scalars(select(ApiToken.secret_hash)),
        }
    assert len(kept) == 3 and not kept & {link, cookie} and all(len(one) == 64 for one in kept)


@pytest.mark.parametrize(
    "value", ["Bearer apx_guessed", "Bearer", "Basic abc", "Bearer apx_", "apx_x", "Bearer \xe9"]
)
def test_wrong_credentials(api: Api, value: str) -> None:
    answer = api.client.get("/v1/me", headers={"Authorization": value.encode("latin-1")})
    assert (answer.status_code, answer.json()["code"]) == (401, "not_signed_in")
    assert answer.headers["www-authenticate"] == "Bearer"


def test_bootstrap_makes_one_owner(settings: Settings, api: Api, capsys, monkeypatch, tmp_path) -> None:
    token_file = tmp_path / "owner.token"
    links = []
    for _ in range(2):
        monkeypatch.setattr("sys.argv", ["bootstrap", "--token-file", str(token_file), "--name", "Ada"])
        bootstrap()
        links.append(capsys.readouterr().out.strip())
    assert token_file.stat().st_mode & 0o777 == 0o600
    bearer = {"Authorization": f"Bearer {token_file.read_text().strip()}"}
    me = api.client.get("/v1/me", headers=bearer).json()
    assert (me["name"], me["is_owner"]) == ("Ada", True)
    with api.database.reading() as session:
        assert len(session.scalars(select(Person)).all()) == 1
    for link in links:
        assert link.startswith("http://127.0.0.1:8000/sign-in#")
        assert api.client.post("/v1/sign-in", json={"link": link}).status_code == 200


def test_what_has_ended_is_forgotten(api: Api, person_id) -> None:
    link_for(api, person_id, hours=-24 * 15)
    api.client.post("/v1/sign-in", json={"link": link_for(api, person_id)})
    remove_ended(api.database)
    assert api.client.get("/v1/me").status_code == 200
    with api.database.writing() as session:
        assert len(session.scalars(select(SignInLink)).all()) == 1
        session.execute(update(BrowserSession).values(expires_at=utc_now() - timedelta(seconds=1)))
    remove_ended(api.database)
    with api.database.reading() as session:
        assert session.scalars(select(BrowserSession)).all() == []
