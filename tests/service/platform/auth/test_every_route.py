"""Every route as nobody, as an outsider and as every role: 401, then 404, then 403 or more.

That is tested here for all routes, and elsewhere only where the role depends on more than the route.
"""

import json
import re
from functools import cache

from sqlalchemy import func, select

from apexcal.documents.roles import ROLES, Role, rank
from service import openapi
from service.platform.db.clock import utc_now
from service.platform.db.models import (
    Analysis,
    Apex,
    ApiToken,
    Base,
    Blob,
    Calibration,
    CalibrationRun,
    CameraFrame,
    CorrespondenceSet,
    CropPage,
    Detection,
    Fleet,
    FleetRequest,
    Job,
    MarkingTask,
    Person,
    Publication,
    Recording,
    Result,
    Rig,
    Sensor,
    Vehicle,
    Vertex,
)
from tests.service.calibrations.test_results import DOCUMENT
from tests.support.databases import one_database
from tests.support.people import Api
from tests.support.rows import add
from tests.support.uploads import RIG

pytestmark = one_database

OPEN = {("post", "/v1/sign-in"), ("get", "/healthz"), ("get", "/readyz")}
# Routes that name no fleet: they answer everybody who is signed in, each from their own fleets.
OF_ANYBODY = {
    ("get", "/v1/me"),
    ("post", "/v1/sign-out"),
    ("get", "/v1/fleets"),
    ("post", "/v1/fleets"),
    ("get", "/v1/recordings"),
    ("get", "/v1/jobs"),
    ("get", "/v1/analyses"),
    ("get", "/v1/workers"),
    ("get", "/v1/export-formats"),
    ("get", "/v1/calibration"),
    ("post", "/v1/calibration-files/reading"),
}
# What is asked of a person's own task, page or question is looked at there: others have none such.
OF_A_PERSON = {
    ("post", "/v1/tasks/{task_id}/answer"),
    ("post", "/v1/tasks/{task_id}/undo"),
    ("post", "/v1/crop-pages/{page_id}/answer"),
    ("post", "/v1/analyses"),
}
OF_OWNERS = {("patch", "/v1/fleets/{id}"), ("delete", "/v1/fleets/{id}")}
# The least role of a change that takes another one than the engineer's.
LEAST: dict[tuple[str, str], Role] = {
    ("patch", "/v1/fleets/{id}"): "admin",
    ("delete", "/v1/fleets/{id}"): "admin",
    ("patch", "/v1/fleets/{id}/members/{person_id}"): "admin",
    ("delete", "/v1/fleets/{id}/members/{person_id}"): "admin",
    ("put", "/v1/fleets/{id}/policy"): "admin",
    ("put", "/v1/rigs/{id}/policy"): "admin",
    ("post", "/v1/results/{result_id}/publication"): "reviewer",
    ("post", "/v1/publications/{publication_id}/withdrawal"): "reviewer",
    ("post", "/v1/detections/{detection_id}/tasks/next"): "annotator",
    ("post", "/v1/detections/{detection_id}/crops/next"): "annotator",
    ("put", "/v1/recordings/{recording_id}/cameras/{camera}/frames/{index}/mark"): "annotator",
    ("post", "/v1/recordings/{recording_id}/rig-proposals"): "viewer",
    ("post", "/v1/results/{result_id}/comparison"): "viewer",
    ("post", "/v1/results/{result_id}/urdf"): "viewer",
    ("post", "/v1/vehicles/{vehicle_id}/cameras/{camera}/calibration/urdf"): "viewer",
}
WORTHLESS = "00000000-0000-7000-8000-000000000000"
# Bodies that cannot be made from their schema alone, by the end of the path.
BODIES = {
    "/rigs": RIG,
    "/detections/{detection_id}/correspondence-sets": {"camera": "front"},
    "/rigs/{rig_id}/correspondence-sets": {"pairs": [{"x": 1.0, "y": 0.0, "z": 0.0, "u": 10.0, "v": 10.0}]},
    "/detections": {"region": {"all": [{"quantity": "x", "op": ">", "value": 0}]}},
    "/analyses": {"kind": "suggestion", "recording_id": WORTHLESS},
    "/fleet-requests": {"vehicles": {}},
    "/address": {"size": 1, "sha256": "0" * 64},
    "/calibration-files/reading": {"files": {"calib.txt": "P0: 1 0 0 0 0 1 0 0 0 0 1 0"}, "image_size": [64, 64]},
    "/arrival": {"reservation": "0" * 32},
}
NOWHERE = {"jobs": "999999"}


@cache
def document() -> dict:
    """The OpenAPI document: every application has the same."""
    return json.loads(openapi.document())


def routes() -> list[tuple[str, str, dict]]:
    """Method, path and description of everything that the application documents."""
    paths = document()["paths"].items()
    return [(method, path, operation) for path, methods in paths for method, operation in methods.items()]


def fill(session, fleet_id) -> dict[str, str]:
    """One row of every table that belongs to the fleet, by the first word of its route."""
    fleet, person = session.get_one(Fleet, fleet_id), session.scalars(select(Person)).first()
    vehicle = add(session, Vehicle, fleet, name="van")
    rig = add(session, Rig, vehicle)
    recording = add(session, Recording, rig)
    blob = add(session, Blob, key=f"recordings/{recording.id}/front")
    sensor = add(session, Sensor, recording, blob_key=blob.key)
    add(session, CameraFrame, sensor)
    swept = add(session, Blob, key=f"recordings/{recording.id}/lidar")
    lidar = add(session, Sensor, recording, blob_key=swept.key, kind="lidar", name="lidar", count=0)
    detection = add(session, Detection, recording, lidar)
    vertex = add(session, Vertex, detection, add(session, Apex, lidar))
    pairs = add(session, CorrespondenceSet, recording)
    calibration = add(session, Calibration, rig, state="queued", remaining=1)
    run = add(session, CalibrationRun, calibration, pairs, fit_request={"seed": 1})
    result = add(session, Result, run, document=DOCUMENT)
    analysis = add(session, Analysis, recording, kind="suggestion", asked={})
    made = {
        "fleets": fleet,
        "vehicles": vehicle,
        "rigs": rig,
        "recordings": recording,
        "jobs": add(session, Job, fleet, subject_id=recording.id),
        "detections": detection,
        "analyses": analysis,
        "vertices": vertex,
        "correspondence-sets": pairs,
        "calibrations": calibration,
        "results": result,
        "publications": add(session, Publication, vehicle, result, led_to=result.id),
        "tokens": add(session, ApiToken, person, fleet, secret_hash="0", name="t"),
        "tasks": add(session, MarkingTask, vertex, sensor, person, leased_until=utc_now()),
        "crop-pages": add(session, CropPage, detection, analysis, sensor, person, crops=[]),
        "fleet-requests": add(session, FleetRequest, fleet),
    }
    return {room: str(row.id) for room, row in made.items()}


def address(path: str, rows: dict[str, str]) -> str:
    """A path with the ids of ``rows`` in it; ids of other packages are worthless ones."""
    room = path.removeprefix("/v1/").split("/")[0]
    filled = path.replace("{camera}", "front").replace("{index}", "0").replace("{number}", "1")
    filled = filled.replace("{alias}", "canary")
    filled = re.sub(r"/(\w[\w-]*)/\{(\w+)\}", lambda at: f"/{at[1]}/{rows.get(at[1], WORTHLESS)}", filled, count=1)
    assert room
    return re.sub(r"\{\w+\}", WORTHLESS, filled)


def send(api: Api, actor, method: str, path: str, operation: dict, rows: dict[str, str]):
    headers = {"Content-Digest": "sha-256=:47DEQpj8HBSa+/TImW+5JCeuQeRkm5NMpJWZG3hSuFU=:"}
    if actor is not None:
        headers["Authorization"] = f"Bearer {actor.token}"
    known = [value for end, value in BODIES.items() if path.endswith(end)] if method == "post" else []
    body = {"json": known[0]} if known else {"json": example(operation)} if "requestBody" in operation else {}
    asked = [one for one in operation.get("parameters", []) if one["in"] == "query"]
    params = {one["name"]: sample(one["schema"], {}) for one in asked if one.get("required")}
    if any(one["name"] == "camera" for one in asked):
        params["camera"] = "front"
    return api.client.request(method, address(path, rows), headers=headers, params=params, **body)


def example(operation: dict):
    """A body that the route's schema accepts, made from the schema itself."""
    content = operation["requestBody"]["content"]
    schema = content.get("application/json", {}).get("schema", {})
    return sample(schema, document()["components"]["schemas"])


def sample(schema: dict, known: dict):
    if "$ref" in schema:
        return sample(known[schema["$ref"].split("/")[-1]], known)
    for key in ("default", "const"):
        if key in schema:
            return schema[key]
    if "enum" in schema:
        return schema["enum"][0]
    for key in ("anyOf", "oneOf"):
        if key in schema:
            return sample(schema[key][0], known)
    kind = schema.get("type")
    if kind == "object":
        return {name: sample(schema["properties"][name], known) for name in schema.get("required", [])}
    if kind == "array":
        items = schema.get("prefixItems")
        if items:
            return [sample(one, known) for one in items]
        return [sample(schema.get("items", {}), known) for _ in range(schema.get("minItems", 0))]
    if kind == "string":
        return WORTHLESS if schema.get("format") == "uuid" else "x"
    if kind in ("integer", "number"):
        return schema.get("minimum", 1)
    return {}


def test_nobody_gets_in_without_signing_in(api: Api) -> None:
    fleet = api.fleet()
    api.member(fleet, "admin")
    with api.database.writing() as session:
        rows = fill(session, fleet)
    for method, path, operation in routes():
        if (method, path) in OPEN:
            continue
        answer = send(api, None, method, path, operation, rows)
        assert answer.status_code == 401, (method, path, answer.text)
        assert answer.json()["code"] == "not_signed_in"


def test_another_fleets_rows_do_not_exist(api: Api) -> None:
    mine, theirs = api.fleet(), api.fleet()
    outsider = api.member(mine, "admin")
    with api.database.writing() as session:
        rows = fill(session, theirs)
    before = snapshot(api)
    for method, path, operation in routes():
        if (method, path) in OPEN | OF_ANYBODY:
            continue
        answer = send(api, outsider, method, path, operation, rows)
        assert answer.status_code == 404, (method, path, answer.text)
        strange = send(api, outsider, method, path, operation, NOWHERE)
        assert strange.status_code == 404 and strange.json() == answer.json(), (method, path)
    for path in ("/recordings", "/jobs", "/analyses", "/fleets"):
        assert theirs.hex not in outsider.get(path).text.replace("-", "")
        if path != "/fleets":
            assert outsider.get(path, params={"fleet_id": str(theirs)}).json()["items"] == []
    assert snapshot(api) == before


def test_a_low_role_is_told_so_only_within_its_own_fleet(api: Api) -> None:
    fleet = api.fleet()
    members = {role: api.member(fleet, role) for role in ROLES}
    with api.database.writing() as session:
        rows = fill(session, fleet)
    api.app.state.store.put_bytes(f"recordings/{rows['recordings']}/front", b"x")
    for role, member in members.items():
        refused = refused_reads(api, member, rows)
        for_engineers = {"/v1/fleets/{id}/members", "/v1/fleets/{id}/tokens", "/v1/recordings/{id}/original"}
        for_engineers |= {"/v1/recordings/{id}/original/parts", "/v1/recordings/{id}/parts"}
        assert for_engineers <= refused if role in ("viewer", "annotator", "reviewer") else not refused


def refused_reads(api: Api, member, rows: dict[str, str]) -> set[str]:
    refused = set()
    for method, path, operation in routes():
        if (method, path) in OPEN | OF_ANYBODY or method != "get":
            continue
        if path.endswith("/events"):
            continue
        answer = send(api, member, method, path, operation, rows)
        assert answer.status_code in (200, 403, 404, 409, 422), (path, answer.text)
        if answer.status_code == 403:
            assert answer.json()["code"] == "role_too_low"
            refused.add(path)
    return refused


def test_a_change_takes_its_role_and_less_changes_nothing(api: Api) -> None:
    fleet = api.fleet()
    members = [api.member(fleet, role) for role in ROLES]
    with api.database.writing() as session:
        rows = fill(session, fleet)
    changes = [
        (method, path, operation, rank(LEAST.get((method, path), "engineer")))
        for method, path, operation in routes()
        if method != "get" and (method, path) not in OPEN | OF_ANYBODY | OF_A_PERSON
    ]
    before = snapshot(api)
    for method, path, operation, least in changes:
        for member in members[:least]:
            answer = send(api, member, method, path, operation, rows)
            assert (answer.status_code, answer.json().get("code")) == (403, "role_too_low"), (method, path)
    assert snapshot(api) == before
    for method, path, operation, least in changes:
        if method != "delete" and (method, path) not in OF_OWNERS:
            answer = send(api, members[least], method, path, operation, rows)
            assert answer.status_code not in (401, 403), (method, path, answer.text)


def snapshot(api: Api) -> dict[str, int]:
    """How many rows each table has."""
    with api.database.reading() as session:
        return {
            name: session.scalar(select(func.count()).select_from(table))
            for name, table in Base.metadata.tables.items()
        }
