"""A client that somebody else's generator makes of the API's description, in Python.

The pages are one in TypeScript, type-checked by `make check`. It drives one whole calibration against the real
service: upload, detection, marks, fit, publication, export, validation, and a 422.
"""

from __future__ import annotations

import base64
import hashlib
import importlib
import io
import json
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from uuid import UUID, uuid4

import pytest

from apexcal.rigs import read_rig
from service.openapi import document
from tests.support import walks
from tests.support.databases import one_database
from tests.support.people import Api
from tests.support.work import work
from workers.tasks.context import Context

GENERATOR = "openapi-python-client==0.29.1"
# Bytes as they are. The generator knows no CSV and leaves that way to bring pairs out; JSON is the other.
BINARY = ("image/png", "image/jpeg", "image/webp", "application/xml", "application/yaml")
OVERRIDES = {
    "application/problem+json": "application/json",
    "application/vnd.apexcal.sweep+gzip": "application/octet-stream",
    **dict.fromkeys(BINARY, "application/octet-stream"),
}
QUICK = {"slots": 2, "population": 200, "generations": 20, "max_iterations": 3}


@pytest.fixture
def given(served: tuple[Api, str], context: Context) -> Iterator[dict[str, Any]]:
    """What a client is told, with the truth's marks by the frame's number. Workers work meanwhile."""
    api, url = served
    walk = walks.walk("plain")
    owner = api.owner()
    frames = json.loads((walk / "truth.json").read_text())["frames"]
    seen = zip(frames["apex_uv"], frames["apex_in_image"], strict=True)
    ended = threading.Event()

    def work_on() -> None:
        while not ended.wait(0.05):
            work(context)

    thread = threading.Thread(target=work_on)
    thread.start()
    yield {
        "url": url,
        "token": owner.token,
        "fleet": str(owner.post("/fleets", {"name": "generated"}).json()["id"]),
        "bag": str(walk / "recording.bag"),
        "rig": read_rig(walk / "rig.json", "front"),
        "region": json.loads((walk / "region.json").read_text()),
        "marks": {str(number): uv if visible else None for number, (uv, visible) in enumerate(seen)},
    }
    ended.set()
    thread.join()


def check(outcome: dict[str, Any]) -> None:
    assert outcome["pairs"] == outcome["validated"] >= 5
    assert outcome["rms_px"] < 30 and outcome["exported"] == 200


@one_database
def test_a_generated_python_client_calibrates(given: dict[str, Any], tmp_path: Path) -> None:
    (tmp_path / "api.json").write_text(document())
    (tmp_path / "config.json").write_text(json.dumps({"content_type_overrides": OVERRIDES}))
    uv = Path(sys.executable).with_name("uv")
    tool = (uv, "tool", "run", "--quiet", "--from", GENERATOR, "openapi-python-client")
    files = ("--meta", "none", "--path", "api.json", "--config", "config.json", "--output-path", "generated_client")
    if (there := subprocess.run([*tool, "--version"], capture_output=True, text=True)).returncode:
        pytest.skip(f"{GENERATOR} cannot be had from the registry here: {there.stderr.strip()}")
    made = subprocess.run([*tool, "generate", *files], cwd=tmp_path, capture_output=True, text=True)
    assert made.returncode == 0, made.stderr
    dropped = [line for line in (made.stdout + made.stderr).splitlines() if line.startswith("WARNING")]
    assert dropped == ["WARNING parsing POST /v1/rigs/{rig_id}/correspondence-sets within calibrations."], made.stderr
    sys.path.insert(0, str(tmp_path))
    try:
        client = Generated(given)
        with client.http:
            check(client.calibrate())
    finally:
        sys.path.remove(str(tmp_path))
        for name in [name for name in sys.modules if name.partition(".")[0] == "generated_client"]:
            del sys.modules[name]


class Generated:
    """The generated client. Its functions and models are found by their names, as its user imports them."""

    def __init__(self, given: dict[str, Any]) -> None:
        self.given = given
        self.http = self._of("client").AuthenticatedClient(base_url=given["url"], token=given["token"])

    def _of(self, module: str) -> Any:
        return importlib.import_module(f"generated_client.{module}")

    def ask(self, operation: str, *path: Any, **more: Any) -> Any:
        """The whole answer of ``tag.operation``; ``body`` is (model, its JSON)."""
        if isinstance(more.get("body"), tuple):
            model, content = more["body"]
            more["body"] = getattr(self._of("models"), model).from_dict(content)
        return self._of(f"api.{operation}").sync_detailed(*path, client=self.http, **more)

    def answer(self, operation: str, *path: Any, **more: Any) -> Any:
        answer = self.ask(operation, *path, **more)
        assert answer.status_code < 300, answer.content
        return answer.parsed

    def until(self, operation: str, id: UUID) -> Any:
        while True:
            row = self.answer(operation, id)
            if str(row.state) in ("ready", "done", "failed", "cancelled"):
                return row
            time.sleep(0.1)

    def calibrate(self) -> dict[str, Any]:
        given, answer = self.given, self.answer
        fleet = UUID(given["fleet"])
        refused = self.ask("fleets.vehicles_create", fleet, body=("Named", {"name": ""}))
        assert (refused.status_code, refused.parsed.code) == (422, "invalid_request") and refused.parsed.hint
        vehicle = answer(
            "fleets.vehicles_create", fleet, body=("Named", {"name": "by Python"}), idempotency_key="one"
        )
        rig = answer("fleets.rigs_create", vehicle.id, body=("NewRig", given["rig"]))
        bag = Path(given["bag"]).read_bytes()
        new = {"name": "walk", "file_name": "walk.bag", "rig_id": str(rig.id), "size": len(bag)}
        id = answer("recordings.recordings_create", vehicle.id, body=("NewRecording", new)).id
        digest = hashlib.sha256(bag)
        field = f"sha-256=:{base64.b64encode(digest.digest()).decode()}:"
        part = self._of("types").File(payload=io.BytesIO(bag))
        answer("recordings.parts_put", id, 1, body=part, content_digest=field)
        whole = {"parts": 1, "size": len(bag), "sha256": digest.hexdigest()}
        answer("recordings.recordings_complete", id, body=("Completion", whole))
        assert self.until("recordings.recordings_get", id).state == "ready"
        request = {"region": given["region"], "detector": "tolerant"}
        detection = answer("detections.detections_create", id, body=("DetectionRequest", request)).id
        assert self.until("detections.detections_get", detection).state == "done"
        while task := answer("annotations.tasks_next", detection, body=("NextTask", {"camera": "front"})):
            pixel = given["marks"][str(task.frame.index)]
            mark = {"mark": dict(zip("uv", pixel, strict=True))} if pixel else {}
            said = {"id": str(uuid4()), "version": 0, "verdict": "confirmed" if pixel else "rejected", **mark}
            answer("annotations.tasks_answer", task.task_id, body=("Answer", said))
        build = ("BuildRequest", {"camera": "front"})
        pairs = answer("calibrations.detections_create_correspondence_set", detection, body=build)
        fit = {"correspondence_set_ids": [str(pairs.id)], "models": ["pinhole"], "folds": 0, "schedule": QUICK}
        started = answer("calibrations.calibrations_create", vehicle.id, body=("CalibrationRequest", fit))
        done = self.until("calibrations.calibrations_get", started.id)
        model = done.summary.cameras["front"].models["pinhole"]
        reason = {"override": {"reason": "a short walk"}}
        answer("publications.results_publication", model.result_id, body=("PublicationRequest", reason))
        # One address answers JSON and files. The generator parses JSON alone: the file is read as bytes.
        request = self._of("api.calibrations.results_get")._get_kwargs(model.result_id, format_="ros2")
        exported = self.http.get_httpx_client().request(**request)
        wanted = {"kind": "pair_validation", "set_id": str(pairs.id), "result_id": str(model.result_id)}
        validation = answer("analyses.analyses_create", body=("PairValidationRequest", wanted))
        checked = self.until("analyses.analyses_get", validation.id)
        return {
            "pairs": pairs.count,
            "rms_px": model.polished.rms_px,
            "exported": exported.status_code,
            "validated": checked.result.pairs,
        }
