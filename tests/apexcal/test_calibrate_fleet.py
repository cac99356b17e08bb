"""``apexcal calibrate-fleet`` and the client against a served service."""

import json
import time
from uuid import UUID

import pytest
from typer.testing import CliRunner, Result

from apexcal.cli import app
from apexcal.client import ApiError, Client
from apexcal.documents.fleets import FleetOut
from tests.faults.jobs import LEVEL_RIG, pairs
from tests.support.served import Embedded


def typed(*words: str) -> Result:
    """The command within this process, whose start costs more than most of what it does."""
    return CliRunner().invoke(app, list(words), prog_name="apexcal")


@pytest.fixture
def fleet(owner: Client) -> FleetOut:
    """A truck with pairs, and a van with none."""
    fleet = owner.fleets.create(f"Fleet {time.monotonic_ns()}")
    truck = owner.vehicles.create(fleet.id, "truck 1")
    rig = owner.vehicles.create_rig(truck.id, LEVEL_RIG)
    owner.correspondence_sets.import_pairs(rig.id, "front", pairs(60))
    owner.vehicles.create(fleet.id, "van 1")
    return fleet


def test_a_fleet_is_calibrated_from_the_command_line(fleet: FleetOut, owner: Client, embedded: Embedded):
    where = ("--url", embedded.url, "--token", embedded.token)
    ask = ("calibrate-fleet", "--fleet", str(fleet.id), "--model", "pinhole", "--folds", "0", *where)
    would = typed(*ask, "--dry-run")
    assert would.exit_code == 0, would.stderr
    assert (
        "The filter names 2 vehicles: 1 would be calibrated in 1 run (at most 1 processor minute), 1 skipped."
        in would.stdout
    )
    assert "van 1 skipped: The vehicle has no correspondence set." in would.stdout
    nobody = typed(*ask, "--name", "bus *")
    assert nobody.exit_code == 1 and "matches none" in nobody.stderr and "Traceback" not in nobody.stderr
    yesterday = typed(*ask, "--not-since", "yesterday")
    assert yesterday.exit_code == 2 and "2026-11-01T00:00:00Z" in yesterday.stderr
    trucks = (*ask, "--name", "truck *")
    withheld = typed(*trucks, "--publish")
    assert withheld.exit_code == 4, withheld.stderr
    assert "truck 1: nothing published for front: " in withheld.stdout
    assert "Published for 0 of 1 calibrated cameras." in withheld.stdout
    id = str(next(iter(owner.fleet_requests.list(fleet.id))).id)
    done = typed("calibrate-fleet", "--follow", id, "--json", *where)
    assert done.exit_code == 4, done.stderr
    request = json.loads(done.stdout)
    assert (request["state"], request["counts"]["done"], request["counts"]["matched"]) == ("done", 1, 1)
    again = typed("calibrate-fleet", "--retry", request["id"], *where)
    assert again.exit_code == 4 and "is done: 1 vehicle, 1 done." in again.stdout
    both = typed("calibrate-fleet", "--retry", request["id"], "--cancel", request["id"], *where)
    assert both.exit_code == 2
    for word in ("--follow", "--retry", "--cancel"):
        nothing = typed("calibrate-fleet", word, "", *where)
        assert nothing.exit_code == 2 and "'' is no id of a fleet request" in nothing.stderr
    assert next(iter(owner.fleet_requests.list(fleet.id))).id == UUID(request["id"]), "nothing new was asked"
    assert typed(*ask, "--folds", "1", "--dry-run").exit_code == 2
    quiet = typed(*ask, "--not-since", "2026-01-01T00:00:00Z", "--name", "truck *")
    assert quiet.exit_code == 0 and "no vehicle is due" in quiet.stdout


def test_the_client_asks_follows_and_cancels(fleet: FleetOut, owner: Client):
    slow = {"population": 2000, "generations": 2000, "max_iterations": 60}
    request = owner.fleet_requests.create(fleet.id, {"name": "truck ?"}, models=["pinhole"], schedule=slow)
    assert owner.fleet_requests.cancel(request.id).cancel_requested
    while (request := owner.fleet_requests.get(request.id)).state == "running":
        time.sleep(0.2)
    assert (request.state, request.counts.cancelled) == ("cancelled", 1)
    assert [one.state for one in owner.fleet_requests.vehicles(request.id)] == ["cancelled"]
    with pytest.raises(ApiError) as refused:
        owner.fleet_requests.preview(fleet.id, {"vehicle_ids": [str(fleet.id)]})
    assert refused.value.code == "unknown_vehicle"
