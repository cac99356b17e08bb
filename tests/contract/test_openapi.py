"""Whatever the API's own description allows, and forbids, is answered: Schemathesis asks, and no answer is a 5xx."""

import importlib
import json
import pkgutil
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple
from uuid import UUID

import httpx
import jsonschema
import pytest
from pydantic import BaseModel
from sqlalchemy import select

from apexcal import documents
from service import description
from service.platform.db.models import Sensor, VertexFrame
from service.platform.http.router import location_of
from tests.faults.jobs import pairs
from tests.service.fleet_requests.conftest import QUICK
from tests.service.platform.auth.test_every_route import OPEN, address, document, fill
from tests.support.databases import one_database
from tests.support.people import Actor, Api
from tests.support.uploads import RIG, new_vehicle
from tests.support.work import work
from workers.tasks.context import Context

TOOL = str(Path(sys.executable).with_name("schemathesis"))
# A stream that never ends, and what answers 503 while no worker runs.
LEFT_OUT = "/events$|^/readyz$"
# Bytes as they are, a page of figures, a stream, the operator's probe, the stored document of the solver.
UNTYPED = {
    "get /healthz",
    "get /metrics",
    "get /readyz",
    "get /v1/events",
    "get /v1/recordings/{id}/cameras/{camera}/frames/{index}",
    "get /v1/recordings/{id}/sweeps/{index}",
    "get /v1/recordings/{id}/original",
    "get /v1/analyses/{analysis_id}/file",
    "get /v1/crop-pages/{page_id}/crops/{index}",
    "Provenance.request",
}


def untyped(schema: Any, schemas: dict[str, Any], where: str, seen: set[str]) -> Iterator[str]:
    """Where a schema says nothing of what is there: no type, an object of anything, a list of anything."""
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        if name not in seen:
            seen.add(name)
            yield from untyped(schemas[name], schemas, name, seen)
        return
    choices = [one for word in ("anyOf", "oneOf", "allOf") for one in schema.get(word, [])]
    for one in choices:
        yield from untyped(one, schemas, where, seen)
    if choices or "enum" in schema or "const" in schema:
        return
    if schema.get("type") == "object":
        members = schema.get("properties", {})
        for name, member in members.items():
            yield from untyped(member, schemas, f"{where}.{name}", seen)
        others = schema.get("additionalProperties")
        if isinstance(others, dict):
            yield from untyped(others, schemas, where, seen)
        elif not members:
            yield where
    elif schema.get("type") == "array":
        items = [*schema.get("prefixItems", []), *([schema["items"]] if schema.get("items") else [])]
        for item in items:
            yield from untyped(item, schemas, f"{where}[]", seen)
        if not items:
            yield where
    elif "type" not in schema:
        yield where


def test_every_answer_says_what_it_holds() -> None:
    described = document()
    found: set[str] = set()
    for path, methods in described["paths"].items():
        for method, operation in methods.items():
            answers = {code: answer for code, answer in operation["responses"].items() if code[0] == "2"}
            assert answers, (method, path)
            for code, answer in answers.items():
                bodies = [body.get("schema", {}) for body in answer.get("content", {"": {}}).values()]
                if code != "204":
                    found |= {
                        one
                        for body in bodies
                        for one in untyped(body, described["components"]["schemas"], f"{method} {path}", set())
                    }
    assert found - UNTYPED == set()


@one_database
def test_a_program_learns_credentials_names_headers_and_refusals(api: Api) -> None:
    described = document()
    operations = {
        (method, path): operation
        for path, methods in described["paths"].items()
        for method, operation in methods.items()
    }
    names = [operation["operationId"] for operation in operations.values()]
    assert len(set(names)) == len(names) and {"vehicles.list", "recordings.complete", "fleets.update"} <= {*names}
    assert {one for one, operation in operations.items() if operation.get("security") == []} == OPEN
    assert described["security"] == [{name: []} for name in described["components"]["securitySchemes"]]
    assert not {"HTTPValidationError", "ValidationError"} & described["components"]["schemas"].keys()
    refused = api.client.get("/v1/me")
    refusal = operations["get", "/v1/me"]["responses"]["default"]["content"]
    schema = refusal[refused.headers["content-type"]]["schema"]["$ref"].rpartition("/")[2]
    assert {*described["components"]["schemas"][schema]["required"]} == refused.json().keys()
    for operation in operations.values():
        assert "422" not in operation["responses"] and operation["responses"]["default"]["content"] == refusal


def test_members_are_described_by_the_sentences_of_their_document_that_name_them() -> None:
    schemas = document()["components"]["schemas"]
    assert schemas["HeldOut"]["properties"]["stretch"]["description"] == "``stretch`` is how that scales lengths."
    assert schemas["HeldOut"]["properties"]["max_px"]["description"] == "the largest distance, pixels"


def test_every_member_and_parameter_is_described_and_no_word_is_idle() -> None:
    described = document()
    schemas = described["components"]["schemas"]
    members = {
        (document, name): one for document, of in schemas.items() for name, one in of.get("properties", {}).items()
    }
    operations = [operation for methods in described["paths"].values() for operation in methods.values()]
    parameters = [one for operation in operations for one in operation.get("parameters", [])]
    assert [place for place, one in members.items() if not one.get("description")] == []
    assert [one["name"] for one in parameters if not one.get("description")] == []
    words = tomllib.loads(Path(description.__file__).with_name("members.toml").read_text("utf-8"))
    used = {one["description"].partition(",")[0] for one in [*members.values(), *parameters]}
    assert [name for name, text in words.items() if text.partition(",")[0] not in used] == []


def test_every_example_is_what_its_schema_and_its_document_take() -> None:
    described = document()
    models = {
        name: model
        for module in pkgutil.iter_modules(documents.__path__)
        for name, model in vars(importlib.import_module(f"apexcal.documents.{module.name}")).items()
        if isinstance(model, type) and issubclass(model, BaseModel)
    }
    checked = 0
    for name, schema in described["components"]["schemas"].items():
        whole = {"$ref": f"#/components/schemas/{name}", "components": described["components"]}
        (example,) = schema["examples"]
        jsonschema.Draft202012Validator(whole, format_checker=jsonschema.FormatChecker()).validate(example)
        if name in models:
            models[name].model_validate_json(json.dumps(example))
            checked += 1
    assert checked > 150


def test_headers_that_a_route_reads_are_described() -> None:
    for method, path, header in (
        ("post", "/v1/fleets", "Idempotency-Key"),
        ("patch", "/v1/fleets/{id}", "If-Match"),
        ("get", "/v1/fleets/{id}", "If-None-Match"),
        ("put", "/v1/recordings/{id}/parts/{number}", "Content-Digest"),
    ):
        parameters = document()["paths"][path][method]["parameters"]
        assert [one["name"] for one in parameters if one["in"] == "header"] == [header]


@one_database
def test_what_is_made_says_where_it_is_read(api: Api) -> None:
    """Each address by the routes, and four of them by their answers."""
    paths = document()["paths"]
    shape = {re.sub(r"\{\w+\}", "{}", path) for path, methods in paths.items() if "get" in methods}
    made = 0
    for path, methods in paths.items():
        for method, operation in methods.items():
            answers = [operation["responses"].get(code) for code in ("201", "202")]
            for answer in filter(None, answers):
                made += 1
                assert method == "post" and "Location" in answer["headers"], path
                assert re.sub(r"\{\w+\}", "{}", location_of(path)) in shape, path
    assert made > 20
    owner = api.owner()
    fleet = owner.post("/fleets", {"name": "made"})
    vehicle = owner.post(f"/fleets/{fleet.json()['id']}/vehicles", {"name": "van"})
    rig = owner.post(f"/vehicles/{vehicle.json()['id']}/rigs", RIG)
    invitation = owner.post(f"/fleets/{fleet.json()['id']}/invitations", {"name": "Ann", "role": "viewer"})
    key = {"Idempotency-Key": "once"}
    again = [owner.post(f"/fleets/{fleet.json()['id']}/vehicles", {"name": "car"}, headers=key) for _ in range(2)]
    for answer in (fleet, vehicle, rig, invitation, *again):
        assert answer.status_code == 201, answer.text
        read = owner.get(answer.headers["location"].removeprefix("/v1"))
        assert read.status_code == 200 and (answer is invitation or read.json()["id"] == answer.json()["id"])


@one_database
def test_head_is_answered_as_get_is_without_the_content(served: tuple[Api, str], context: Context) -> None:
    api, url = served
    fleet = api.fleet()
    engineer = api.member(fleet, "engineer")
    rows = rows_of(api, fleet, engineer, context)
    heads = 0
    with httpx.Client(headers={"Authorization": f"Bearer {engineer.token}"}, timeout=60) as client:
        for path, methods in document()["paths"].items():
            if "get" not in methods or not path.startswith("/v1/"):
                continue
            head = client.head(url + address(path, rows))
            with client.stream("GET", url + address(path, rows)) as get:
                assert (head.status_code, head.content) == (get.status_code, b""), path
                names = ("content-type", "etag", "content-length", "allow")
                # A problem names its request, whose id may be of another length.
                names = names if get.status_code < 400 else names[:1]
                assert [head.headers.get(name) for name in names] == [get.headers.get(name) for name in names], path
            heads += head.status_code == 200
        assert client.head(f"{url}/v1/sign-out").status_code == 405
    assert heads > 20


class Asked(NamedTuple):
    """What came of a run: requests sent, how many were answered with 2xx, and each answer of 500 and above."""

    requests: int
    accepted: int
    failures: list[str]


def rows_of(api: Api, fleet: Any, engineer: Actor, context: Context) -> dict[str, str]:
    """Ids of rows of every kind; the calibration, its result and its publication are real ones."""
    with api.database.writing() as session:
        rows = fill(session, fleet)
        sensor = session.scalars(select(Sensor.id).where(Sensor.kind == "camera")).one()
        session.add(VertexFrame(vertex_id=UUID(rows["vertices"]), sensor_id=sensor, frame_index=0, gap_ns=0))
    van = new_vehicle(engineer, fleet, "calibrated")
    brought = engineer.post(
        f"/rigs/{van['rig']}/correspondence-sets", {"pairs": pairs(40, 1)}, params={"camera": "front"}
    ).json()
    body = {"vehicles": {"name": "calibrated"}, "calibration": QUICK}
    request = engineer.post(f"/fleets/{fleet}/fleet-requests", body).json()
    work(context)
    (calibration,) = engineer.get(f"/vehicles/{van['vehicle']}/calibrations").json()["items"]
    result = calibration["summary"]["cameras"]["front"]["models"]["pinhole"]["result_id"]
    # A search this short has objections: it is published against them.
    override = {"override": {"reason": "for the addresses that need one"}}
    assert engineer.post(f"/results/{result}/publication", override).status_code == 201
    real = {"vehicles": van["vehicle"], "rigs": van["rig"], "correspondence-sets": brought["id"], "results": result}
    return rows | real | {"calibrations": calibration["id"], "fleet-requests": request["id"]}


def ids(rows: dict[str, str]) -> str:
    """A configuration that puts rows which exist into the paths."""
    lines: list[str] = []
    for path in document()["paths"]:
        if "{" not in path:
            continue
        parts = zip(path.split("/"), address(path, rows).split("/"), strict=True)
        lines += ["[[operations]]", f'include-path = "{path}"', "[operations.parameters]"]
        lines += [f'"path.{name[1:-1]}" = "{value}"' for name, value in parts if name.startswith("{")]
    return "\n".join(lines)


def ask(url: str, actor: Actor, folder: Path, config: str, *more: str) -> Asked:
    """Run Schemathesis, always with the same seed."""
    folder.mkdir()
    (folder / "schemathesis.toml").write_text(config)
    report, described = folder / "report.ndjson", folder / "openapi.json"
    # From an address it would be read within ten seconds or not at all.
    described.write_text(httpx.get(f"{url}/v1/openapi.json", timeout=300).text)
    command = [
        *(TOOL, "--config-file", str(folder / "schemathesis.toml"), "run", str(described), "--url", url),
        *(
            "--header",
            f"Authorization: Bearer {actor.token}",
            "--checks",
            "not_a_server_error,response_schema_conformance",
        ),
        *("--exclude-path-regex", LEFT_OUT, "--seed", "7", "--generation-database", "none", "--warnings", "off"),
        *("--continue-on-failure", "--no-shrink", "--request-timeout", "60", "--suppress-health-check", "all"),
        *("--report", "ndjson", "--report-ndjson-path", str(report), *more),
    ]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode in (0, 1) and report.exists(), done.stdout + done.stderr
    answers = [answer for line in report.read_text().splitlines() for answer in answers_in(json.loads(line))]
    assert done.returncode == 0 or any(status >= 500 for _, status in answers), done.stdout
    failures = [f"{status} {what}" for what, status in answers if status >= 500]
    return Asked(len(answers), sum(200 <= status < 300 for _, status in answers), failures)


def answers_in(event: dict[str, Any]) -> Iterator[tuple[str, int]]:
    """What was asked and the status of its answer, of everything that an event of the report holds."""
    for scenario in event.values():
        recorder = scenario.get("recorder") or {}
        for id, sent in recorder.get("interactions", {}).items():
            case = recorder["cases"][id]["value"]
            assert sent["response"] is not None, f"no answer: {case}"
            yield f"{case['method']} {case['path']} {case.get('body')!r:.300}", sent["response"]["status_code"]


@one_database
def test_a_quick_look_finds_no_failure(served: tuple[Api, str], context: Context, tmp_path: Path) -> None:
    api, url = served
    fleet = api.fleet()
    engineer = api.member(fleet, "engineer")
    config = ids(rows_of(api, fleet, engineer, context))
    asked = ask(
        *(url, engineer, tmp_path / "quick", config, "--exclude-method", "DELETE"),
        *("--phases", "fuzzing", "--max-examples", "1"),
    )
    assert asked.failures == []
    assert asked.requests > 100 and asked.accepted > 20


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_a_long_look_finds_no_failure(served: tuple[Api, str], context: Context, tmp_path: Path) -> None:
    api, url = served
    fleet = api.fleet()
    engineer = api.member(fleet, "engineer")
    config = ids(rows_of(api, fleet, engineer, context))
    kept = ("--exclude-method", "DELETE", "--phases", "coverage,fuzzing", "--max-examples", "30")
    known = ask(url, engineer, tmp_path / "known", config, *kept)
    found = ask(url, engineer, tmp_path / "found", "", "--phases", "fuzzing,stateful", "--max-examples", "15")
    print(f"rows that exist: {known[:2]}; rows that it finds itself: {found[:2]}")
    assert known.failures + found.failures == []
    assert known.requests > 4000 and found.requests > 1000 and known.accepted > 200
