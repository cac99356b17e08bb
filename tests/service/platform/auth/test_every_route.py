"""Every route as nobody, as an outsider and as every role: 401, then 404, then 403 or more."""

import re

import pytest
from sqlalchemy import func, select

from apexcal.documents.roles import ROLES
from service.platform.db.clock import utc_now
from service.platform.db.ids import new_id
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
    Detection,
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
    ("post", "/v1/rig-drafts"),
}
WORTHLESS = "00000000-0000-7000-8000-000000000000"
# Bodies that cannot be made from their schema alone, by the end of the path.
BODIES = {
    "/rigs": RIG,
    "/detections/{detection_id}/correspondence-sets": {"camera": "front"},
    "/rigs/{rig_id}/correspondence-sets": {"pairs": [{"x": 1.0, "y": 0.0, "z": 0.0, "u": 10.0, "v": 10.0}]},
    "/detections": {"region": {"quantity": "x", "op": ">", "value": 0}},
    "/analyses": {"kind": "suggestion", "recording_id": WORTHLESS},
    "/fleet-requests": {"vehicles": {}},
    "/address": {"size": 1, "sha256": "0" * 64},
    "/calibration-files/reading": {"files": {"calib.txt": "P0: 1 0 0 0 0 1 0 0 0 0 1 0"}, "image_size": [64, 64]},
    "/recordings/{recording_id}/rig-drafts": {
        "name": "roof",
        "lidar_link": "velodyne",
        "cameras": [{"name": "front", "link": "camera", "image_size": [640, 480]}],
    },
    "/rig-drafts": {
        "name": "roof",
        "lidar_link": "velodyne",
        "urdf": "<robot/>",
        "cameras": [{"name": "front", "link": "camera", "image_size": [640, 480]}],
    },
    "/arrival": {"reservation": "0" * 32},
}
NOWHERE = {"jobs": "999999"}


_documents: list[dict] = []


def document(api: Api) -> dict:
    """The OpenAPI document, made once: every application has the same."""
    if not _documents:
        _documents.append(api.app.openapi())
    return _documents[0]


def routes(api: Api) -> list[tuple[str, str, dict]]:
    """Method, path and description of everything that the application documents."""
    found = []
    for path, methods in document(api)["paths"].items():
        found += [(method, path, operation) for method, operation in methods.items()]
    assert len(found) > 30
    return found


def fill(session, fleet_id) -> dict[str, str]:
    """One row of every table that belongs to the fleet, by the first word of its route."""
    vehicle = Vehicle(id=new_id(), fleet_id=fleet_id, name="van")
    rig = Rig(id=new_id(), fleet_id=fleet_id, vehicle_id=vehicle.id, name="roof", lidar_frame="velodyne")
    recording = Recording(
        id=new_id(),
        fleet_id=fleet_id,
        vehicle_id=vehicle.id,
        rig_id=rig.id,
        name="drive",
        file_name="drive.bag",
        state="ready",
    )
    blob = Blob(key=f"recordings/{recording.id}/front", state="stored")
    sensor = Sensor(
        id=new_id(),
        recording_id=recording.id,
        kind="camera",
        name="front",
        topic="/front",
        frame_id="front",
        blob_key=blob.key,
        count=1,
        first_ns=0,
        last_ns=0,
        facts={},
    )
    frame = CameraFrame(
        sensor_id=sensor.id, index=0, stamp_ns=0, offset=0, length=1, media_type="image/png", width=1, height=1
    )
    job = Job(fleet_id=fleet_id, kind="ingest", queue="ingest", subject_id=recording.id)
    for row in (vehicle, rig, blob, recording, sensor, frame, job):
        session.add(row)
        session.flush()
    made = {"fleets": fleet_id, "vehicles": vehicle.id, "rigs": rig.id, "recordings": recording.id, "jobs": job.id}
    return {room: str(value) for room, value in (made | found(session, recording, rig, sensor)).items()}


def found(session, recording: Recording, rig: Rig, sensor: Sensor) -> dict[str, object]:
    """What detection, marking and calibration leave of a recording."""
    owned = {"fleet_id": recording.fleet_id, "recording_id": recording.id}
    detection = Detection(
        id=new_id(),
        **owned,
        region={"quantity": "x", "op": ">", "value": 0.0},
        detector="strict",
        options={},
        pairing={},
        content_hash="0",
        state="done",
    )
    analysis = Analysis(id=new_id(), **owned, vehicle_id=rig.vehicle_id, kind="suggestion", asked={})
    apex = Apex(id=new_id(), recording_id=recording.id, sweep_index=0, x=1, y=0, z=0)
    vertex = Vertex(
        id=new_id(), detection_id=detection.id, apex_id=apex.id, rank=0, sweep_index=0, time_ns=0, x=1, y=0, z=0
    )
    vertex.ring, vertex.points = 3, 1
    pairs = CorrespondenceSet(
        id=new_id(), **owned, vehicle_id=rig.vehicle_id, rig_id=rig.id, camera="front", source="import"
    )
    pairs.content_hash, pairs.count, pairs.pairs = "0", 0, {}
    calibration = Calibration(
        id=new_id(), fleet_id=rig.fleet_id, vehicle_id=rig.vehicle_id, rig_id=rig.id, request={}, content_hash="0"
    )
    calibration.remaining, calibration.publish = 1, "none"
    run = CalibrationRun(
        id=new_id(), fleet_id=rig.fleet_id, calibration_id=calibration.id, set_id=pairs.id, camera="front", fold=-1
    )
    run.model, run.farm, run.slots, run.bundle, run.problem = "pinhole", "runs", 1, 1, {"seed": 1}
    result = Result(id=new_id(), fleet_id=rig.fleet_id, calibration_id=calibration.id, run_id=run.id, camera="front")
    result.model, result.fold, result.document = "pinhole", -1, DOCUMENT
    person = session.scalars(select(Person)).first()
    token = ApiToken(id=new_id(), secret_hash="0", name="t", person_id=person.id, fleet_id=rig.fleet_id)
    task = MarkingTask(
        id=new_id(), detection_id=detection.id, vertex_id=vertex.id, sensor_id=sensor.id, person_id=person.id
    )
    task.leased_until = utc_now()
    request = FleetRequest(
        id=new_id(),
        fleet_id=rig.fleet_id,
        asked={"vehicles": {}, "calibration": {"publish": "none"}},
        state="done",
        matched=1,
        remaining=0,
        wave=0,
    )
    publication = Publication(
        id=new_id(), fleet_id=rig.fleet_id, vehicle_id=rig.vehicle_id, camera="front", alias="current", number=1
    )
    publication.result_id = publication.led_to = result.id
    own = (
        detection,
        analysis,
        apex,
        vertex,
        pairs,
        calibration,
        run,
        result,
        publication,
        token,
        task,
    )
    for row in (*own, request):
        session.add(row)
        session.flush()
    return {
        "detections": detection.id,
        "analyses": analysis.id,
        "vertices": vertex.id,
        "correspondence-sets": pairs.id,
        "calibrations": calibration.id,
        "results": result.id,
        "publications": publication.id,
        "tokens": token.id,
        "tasks": task.id,
        "fleet-requests": request.id,
    }


def address(path: str, rows: dict[str, str]) -> str:
    """A path with the ids of ``rows`` in it; ids of other rooms are worthless ones."""
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
    body = {"json": known[0]} if known else {"json": example(api, operation)} if "requestBody" in operation else {}
    asked = [one for one in operation.get("parameters", []) if one["in"] == "query"]
    params = {one["name"]: sample(one["schema"], {}) for one in asked if one.get("required")}
    if any(one["name"] == "camera" for one in asked):
        params["camera"] = "front"
    return api.client.request(method, address(path, rows), headers=headers, params=params, **body)


def example(api: Api, operation: dict):
    """A body that the route's schema accepts, made from the schema itself."""
    content = operation["requestBody"]["content"]
    schema = content.get("application/json", {}).get("schema", {})
    return sample(schema, document(api)["components"]["schemas"])


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
    for method, path, operation in routes(api):
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
    for method, path, operation in routes(api):
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
    for method, path, operation in routes(api):
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


@pytest.mark.parametrize("role", ["viewer", "annotator", "reviewer"])
def test_low_roles_change_nothing_of_an_engineers(api: Api, role: str) -> None:
    fleet = api.fleet()
    member = api.member(fleet, role)
    with api.database.writing() as session:
        rows = fill(session, fleet)
    before = snapshot(api)
    edits = [
        ("post", f"/fleets/{fleet}/vehicles", {"name": "x"}),
        ("patch", f"/fleets/{fleet}", {"name": "x"}),
        ("post", f"/fleets/{fleet}/invitations", {"name": "x", "role": "viewer"}),
        ("post", f"/fleets/{fleet}/tokens", {"name": "x", "role": "viewer"}),
        ("patch", f"/vehicles/{rows['vehicles']}", {"name": "x"}),
        ("patch", f"/recordings/{rows['recordings']}", {"name": "x"}),
        ("delete", f"/recordings/{rows['recordings']}", None),
        ("post", f"/recordings/{rows['recordings']}/retry", None),
        ("post", f"/fleets/{fleet}/fleet-requests", {"vehicles": {}}),
        ("post", f"/fleet-requests/{rows['fleet-requests']}/retry", None),
        ("post", f"/fleet-requests/{rows['fleet-requests']}/cancel", None),
        ("post", f"/recordings/{rows['recordings']}/complete", {"parts": 1, "size": 1}),
        ("post", f"/vehicles/{rows['vehicles']}/recordings", {"rig_id": rows["rigs"], "name": "x", "file_name": "x"}),
    ]
    for method, path, body in edits:
        answer = member.request(method.upper(), path, **({"json": body} if body else {}))
        assert (answer.status_code, answer.json()["code"]) == (403, "role_too_low"), (path, answer.text)
    assert snapshot(api) == before


def snapshot(api: Api) -> dict[str, int]:
    """How many rows each table has."""
    with api.database.reading() as session:
        return {
            name: session.scalar(select(func.count()).select_from(table))
            for name, table in Base.metadata.tables.items()
        }
