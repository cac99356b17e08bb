"""Whatever goes wrong is a problem document that says what to do."""

import pickle
import re

import pytest
from sqlalchemy import text

from apexcal.documents.errors import InputError
from service.platform.http.limits import BusyProblem
from service.platform.http.problems import Problem
from service.platform.http.web import Pages
from tests.service.platform.auth.test_every_route import document
from tests.support.people import Api


def check_document(answer, status: int, code: str) -> dict:
    assert (answer.status_code, answer.headers["content-type"]) == (status, "application/problem+json"), answer.text
    document = answer.json()
    assert document["code"] == code and document["status"] == status
    assert document["type"] == f"urn:apexcal:problem:{code}" and document["title"] and document["detail"]
    return document


def test_no_such_address_and_method(api: Api) -> None:
    check_document(api.client.get("/v1/nothing"), 404, "no_such_route")
    owner = api.owner()
    check_document(owner.post("/nothing"), 404, "no_such_route")
    check_document(api.client.post("/nothing", headers=owner.headers), 404, "no_such_route")
    document = check_document(owner.put("/me"), 405, "method_not_allowed")
    assert "GET" in document["hint"]


@pytest.mark.parametrize(
    ("body", "field", "says"),
    [
        ({"json": {}}, "name", "required"),
        ({"json": {"name": ""}}, "name", "at least 1"),
        ({"json": {"name": "a\u202eb"}}, "name", "direction"),
        ({"json": {"name": "a\u0000b"}}, "body", "control character"),
        ({"json": {"name": "x" * 201}}, "name", "at most 200"),
        ({"json": {"name": "x", "nmae": "y"}}, "nmae", "not known here"),
        ({"content": b"{", "headers": {"Content-Type": "application/json"}}, "body", "no JSON"),
        ({}, "body", "JSON object"),
    ],
)
def test_invalid_bodies_name_the_field(api: Api, body: dict, field: str, says: str) -> None:
    document = check_document(api.owner().request("POST", "/fleets", **body), 422, "invalid_request")
    assert document["errors"][0]["field"] == field and says in document["errors"][0]["message"]
    assert field in document["detail"] and document["hint"]


def test_invalid_addresses_and_queries_name_the_field(api: Api) -> None:
    owner = api.owner()
    document = check_document(owner.get("/fleets/12"), 422, "invalid_request")
    assert document["errors"][0]["field"] == "path id" and "is no id" in document["detail"]
    document = check_document(owner.get("/fleets", params={"limit": 101}), 422, "invalid_request")
    assert document["errors"][0]["field"] == "query limit"


def test_a_bug_shows_nothing_of_itself(api: Api, caplog) -> None:
    @api.app.get("/v1/bug")
    def bug() -> None:
        raise RuntimeError("the secret inside")

    document = check_document(api.client.get("/v1/bug"), 500, "internal_error")
    assert "secret" not in str(document)
    assert "the secret inside" in caplog.text


def test_thousands_of_wrong_fields_are_answered_shortly(api: Api) -> None:
    answer = api.owner().post("/fleets", {f"field {number}": 0 for number in range(4000)})
    document = check_document(answer, 422, "invalid_request")
    assert len(document["errors"]) == 50 and "4000 more" in document["detail"]


def test_answers_carry_safe_headers(api: Api) -> None:
    for path in ("/v1/me", "/", "/v1/nothing"):
        headers = api.client.get(path).headers
        assert "default-src 'self'" in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff"
    assert api.client.get("/v1/me").headers["cache-control"] == "private, no-cache"


def test_pages_are_served_and_nothing_beside_them(api: Api, tmp_path) -> None:
    web = tmp_path / "web"
    (web / "assets").mkdir(parents=True)
    (web / "index.html").write_text("<p>pages</p>")
    (web / "assets/app-1a2b.js").write_text("1")
    (tmp_path / "secret").write_text("no")
    api.app.router.default = Pages(web)
    for path in ("/", "/recordings/7", "/sign-in", "/index.html"):
        answer = api.client.get(path, headers={"Accept": "text/html"})
        assert answer.text == "<p>pages</p>" and answer.headers["cache-control"] == "no-cache"
    script = api.client.get("/assets/app-1a2b.js")
    assert script.text == "1" and "immutable" in script.headers["cache-control"]
    assert api.client.get("/assets/none.js").status_code == 404
    for path in ("/%2e%2e/secret", "/assets/%2e%2e/%2e%2e/secret", "/%00", "/../secret"):
        assert api.client.get(path).text != "no"
    assert api.client.get("/v1/none").json()["code"] == "no_such_route"


def test_a_schema_of_another_version_is_said(api: Api) -> None:
    @api.app.get("/v1/old/{what}")
    def old(what: str) -> None:
        with api.database.reading() as session:
            session.execute(text({"column": "SELECT colour FROM fleet", "table": "SELECT * FROM colour"}[what]))

    for what in ("column", "table"):
        document = check_document(api.client.get(f"/v1/old/{what}"), 503, "schema_mismatch")
        assert "python -m service.platform.db.migrate" in document["hint"]


@pytest.mark.parametrize("host", ["[", "]", "[::1", "127.0.0.1:x", "a b"])
@pytest.mark.parametrize("origin", ["http://[", "null"])
def test_hosts_and_origins_that_are_none_are_refused(api: Api, host: str, origin: str) -> None:
    headers = {"Host": host, "Origin": origin, "Cookie": "apexcal_session=x", "Idempotency-Key": "k"}
    for path in ("/v1/sign-in", "/v1/fleets"):
        answer = api.client.post(path, json={"link": "x"}, headers=headers)
        assert (answer.status_code, answer.headers["content-type"]) == (403, "application/problem+json")
    check_document(api.client.get("/v1/nothing", headers=headers), 404, "no_such_route")
    token = {"Host": host, "Authorization": f"Bearer {api.owner().token}", "Idempotency-Key": "k"}
    assert api.client.post("/v1/fleets", json={"name": "x"}, headers=token).status_code == 201


def test_a_link_that_is_none_is_unknown(api: Api) -> None:
    for link in ("http://[", "//[x", "#", " ", "http://[#x"):
        check_document(api.client.post("/v1/sign-in", json={"link": link}), 404, "link_unknown")


@pytest.mark.parametrize(
    "path", ["%0a" + "x" * 230, "x" * 300, "%00", "a/" * 600 + "x" * 300, "%ff%fe%0a" + "x" * 230]
)
def test_an_address_that_no_file_can_have_is_a_page(api: Api, path: str) -> None:
    answer = api.client.get(f"/{path}", headers={"Accept": "text/html"})
    assert (answer.status_code, answer.headers["content-type"]) == (200, "text/html; charset=utf-8"), answer.text
    check_document(api.client.get(f"/assets/{path}"), 404, "no_such_route")
    check_document(api.client.get(f"/v1/{path}"), 404, "no_such_route")


def test_every_parameter_of_the_description_is_read(api: Api) -> None:
    owner, somewhere = api.owner(), "0" * 32
    for path, operations in document()["paths"].items():
        for one in operations.get("get", {}).get("parameters", []):
            if one["in"] == "query" and path.startswith("/v1"):
                address = re.sub("{[^}]+}", somewhere, path.removeprefix("/v1"))
                answer = owner.get(address, params={one["name"]: "1"})
                assert f"query {one['name']}: is not known here" not in answer.text, (path, one["name"])


def test_no_route_overlooks_a_misspelt_parameter(api: Api) -> None:
    headers = {"Authorization": f"Bearer {api.owner().token}"}
    for path, operations in document()["paths"].items():
        address = re.sub("{[^}]+}", "0" * 32, path)
        for method, operation in operations.items() if path.startswith("/v1") else ():
            known = {one["name"] for one in operation.get("parameters", ()) if one["in"] == "query"}
            for name in {"nonsense", *(f"{one}s" for one in known)} - known:
                answer = api.client.request(method, address, headers=headers, params={name: "1"})
                assert answer.status_code == 422, (method, path, name, answer.text)
                fields = [error["field"] for error in answer.json()["errors"]]
                assert fields == [f"query {name}"], (method, path, fields)
                nearest = name.removesuffix("s")
                assert nearest not in known or f"`{nearest}`" in answer.json()["detail"], (method, path, name)


def test_a_refusal_comes_from_another_process_as_it_was():
    for error in (Problem(422, "wrong", "It is.", "Mend it.", headers={"A": "b"}, names=["x"]), BusyProblem(2.0)):
        again = pickle.loads(pickle.dumps(error))
        assert (type(again), str(again), again.__dict__) == (type(error), str(error), error.__dict__)
    error = InputError("wrong", "It is.", "Mend it.", names=["x"])
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again), again.__dict__) == (InputError, str(error), error.__dict__)
