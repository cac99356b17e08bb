"""`apexcal ls`, `show`, `open`, `rm` and `--version`, against a service."""

from __future__ import annotations

import json
from importlib.metadata import version
from pathlib import Path

import pytest
from typer.testing import CliRunner

from apexcal.cli import app
from apexcal.client import Client
from tests.faults.jobs import LEVEL_RIG, SHORT, pairs
from tests.support.served import Embedded


@pytest.fixture(scope="module")
def fleet(embedded: Embedded) -> str:
    """Two vehicles, of which one has a rig and a calibration."""
    with Client(embedded.url, embedded.token) as client:
        fleet = client.fleets.create("Listing")
        client.vehicles.create(fleet.id, "Bus 10")
        vehicle = client.vehicles.create(fleet.id, "Bus 2")
        rig = client.vehicles.create_rig(vehicle.id, LEVEL_RIG)
        of = client.correspondence_sets.import_pairs(rig.id, "front", pairs(200)).id
        calibration = client.calibrations.create(vehicle.id, [of], ["pinhole"], folds=0, schedule=SHORT)
        client.wait(calibration)
    return fleet.name


def ls(embedded: Embedded, *words: str) -> str:
    ran = CliRunner().invoke(app, ["ls", *words, "--url", embedded.url, "--token", embedded.token])
    assert ran.exit_code == 0, ran.stderr
    return ran.stdout


def test_vehicles_with_their_state(embedded: Embedded, fleet: str):
    assert ls(embedded, "--fleet", fleet).index("Bus 2") < ls(embedded, "--fleet", fleet).index("Bus 10")
    cameras = json.loads(ls(embedded, "vehicles", "--fleet", fleet, "--json"))
    assert [(each["vehicle"], each["state"], each["work"]) for each in cameras] == [
        ("Bus 2", "none", "decision"),
        ("Bus 10", None, "recording"),
    ]
    assert "Bus 10" not in ls(embedded, "vehicles", "bus 2", "--fleet", fleet)
    assert ls(embedded, "vehicles", "--fleet", fleet, "--state", "withdrawn").strip() == "None."


def test_calibrations_and_recordings(embedded: Embedded, fleet: str):
    (calibration,) = json.loads(ls(embedded, "calibrations", "Bus 2", "--fleet", fleet, "--json"))
    assert calibration["state"] == "done" and "front: " in ls(embedded, "calibrations", "Bus 2", "--fleet", fleet)
    assert ls(embedded, "recordings", "--fleet", fleet).strip() == "None."


def test_the_version_is_that_of_the_package():
    assert CliRunner().invoke(app, ["--version"]).stdout.strip() == f"apexcal {version('apexcal')}"


def test_the_cameras_of_one_vehicle_by_its_name_or_id(embedded: Embedded, fleet: str):
    every = json.loads(ls(embedded, "vehicles", "--fleet", fleet, "--json"))
    bus = next(each for each in every if each["vehicle"] == "Bus 2")
    for word in ("Bus 2", bus["vehicle_id"]):
        assert json.loads(ls(embedded, "--fleet", fleet, "--vehicle", word, "--json")) == [bus]


def run(embedded: Embedded, *words: str, exit_code: int = 0):
    ran = CliRunner().invoke(app, [*words, "--url", embedded.url, "--token", embedded.token])
    assert ran.exit_code == exit_code, ran.stderr
    return ran


def test_a_thing_by_name_or_as_the_last_one(embedded: Embedded, fleet: str, tmp_path: Path):
    of = ("--fleet", fleet)
    (tmp_path / "stroll.bag").write_text("no bag")
    with Client(embedded.url, embedded.token) as client:
        elsewhere = client.vehicles.create(client.fleets.create("Elsewhere").id, "Van 1")
        client.recordings.upload(tmp_path / "stroll.bag", elsewhere.id)
    (calibration,) = json.loads(ls(embedded, "calibrations", "Bus 2", *of, "--json"))
    for name in (calibration["id"], "Bus 2", "@last"):
        shown = run(embedded, "show", "calibration", name, *of)
        assert calibration["id"] in shown.stdout and "front pinhole: result " in shown.stdout
        assert shown.stderr.strip() == f"Next: apexcal open calibration {calibration['id']}"
        opened = run(embedded, "open", "calibration", name, *of).stdout.strip()
        assert opened == f"{embedded.url.rstrip('/')}/calibrations/{calibration['id']}"
    bus = run(embedded, "show", "vehicle", "Bus 2", *of).stdout
    assert "front: none, work: decision" in bus and calibration["id"] in bus
    for command in ("show", "open", "rm"):
        for name in ("@last", "stroll.bag", "stroll"):
            assert "no recording" in run(embedded, command, "recording", name, *of, exit_code=1).stderr


def test_a_result_is_named_by_its_vehicle(embedded: Embedded, fleet: str, tmp_path):
    report = tmp_path / "report.html"
    made = run(embedded, "report", "Bus 2", "-o", str(report))
    assert report.stat().st_size > 10_000 and "Its verdict: " in made.stdout
    assert "'Bus 2'" in run(embedded, "report", "Bus 3", "-o", str(tmp_path / "b.html"), exit_code=1).stderr


def test_names_are_completed(embedded: Embedded, fleet: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("APEXCAL_URL", embedded.url)
    monkeypatch.setenv("APEXCAL_TOKEN", embedded.token)
    said = {"_APEXCAL_COMPLETE": "complete_bash", "COMP_WORDS": "apexcal show vehicle Bus", "COMP_CWORD": "3"}
    completed = CliRunner().invoke(app, [], env=said, prog_name="apexcal")
    assert {"Bus 2", "Bus 10"} <= set(completed.stdout.splitlines())
    monkeypatch.setenv("APEXCAL_URL", "http://127.0.0.1:9")
    assert CliRunner().invoke(app, [], env=said, prog_name="apexcal").stdout.strip() == ""


def test_a_thing_is_deleted_when_it_is_meant(embedded: Embedded, fleet: str):
    run(embedded, "rm", "vehicle", "Bus 10", "--fleet", fleet, exit_code=2)
    assert "Bus 10" in ls(embedded, "--fleet", fleet)
    assert "Deleted the vehicle Bus 10" in run(embedded, "rm", "vehicle", "Bus 10", "--fleet", fleet, "--yes").stdout
    assert "Bus 10" not in ls(embedded, "--fleet", fleet)
