"""The whole job through the fleet of docker-compose.yml: its own commands and environment, as plain processes."""

import json
import sys
from collections.abc import Callable, Iterator
from datetime import timedelta
from pathlib import Path
from uuid import UUID

import httpx
import pytest

from apexcal.client import Client
from apexcal.documents.recordings import BlobAddress, Parts
from apexcal.regions import read_region
from apexcal.rigs import read_rig
from benchmarks.demo.annotators import mark_everything
from benchmarks.demo.truth import Truth
from service.platform.db.session import Database
from service.platform.settings import Settings
from service.platform.storage.audit import audit
from service.platform.storage.store import open_store
from tests.integration.fleet import APIS, WORKERS, ComposeFleet
from tests.support.processes import start, stop

SECONDS = 10
QUICK = {"slots": 2, "population": 300, "generations": 20, "max_iterations": 3}
# What a loaded machine may need; an idle one takes a tenth of it.
PATIENCE_S = 150


@pytest.fixture
def walk(tmp_path: Path) -> Iterator[Callable[[], Path]]:
    """A recording that is simulated while the fleet starts; called, it waits for its folder."""
    command = [sys.executable, "-m", "workers.simulation", "--out", str(tmp_path / "walk"), "--seconds", str(SECONDS)]
    child = start(command, tmp_path / "simulation.log")

    def wait() -> Path:
        assert child.wait(PATIENCE_S) == 0, (tmp_path / "simulation.log").read_text()
        return tmp_path / "walk"

    yield wait
    stop(child)


def test_the_job_goes_through_the_fleet_of_the_compose_file(
    walk: Callable[[], Path], fleet: ComposeFleet, tmp_path: Path
) -> None:
    fleet.wait_until_healthy((*APIS, *WORKERS, "sweeper"), PATIENCE_S)
    folder = walk()
    bag = folder / "recording.bag"
    with Client(fleet.url, fleet.token) as owner:
        trucks = owner.fleets.create("Trucks")
        vehicle = owner.vehicles.create(trucks.id, "Truck 7")
        rig = owner.vehicles.create_rig(vehicle.id, read_rig(folder / "rig.json", "front"))
        recording = owner.wait(owner.recordings.upload(bag, vehicle.id, rig.id), timeout_s=PATIENCE_S)
        detection = owner.wait(
            owner.detections.create(recording.id, read_region(folder / "region.json"), detector="tolerant"),
            timeout_s=PATIENCE_S,
        )
        marked, _ = mark_everything(
            owner, trucks.id, detection, "front", Truth(folder / "truth.json"), lambda share, message: None
        )
        pairs = owner.correspondence_sets.build(detection.id, "front")
        assert marked.complete == detection.counts.paired >= pairs.count >= 10
        calibration = owner.wait(
            owner.calibrations.create(
                vehicle.id, [pairs.id], ["pinhole"], folds=0, farm="slots", schedule=QUICK, publish="recommended"
            ),
            timeout_s=PATIENCE_S,
        )
        found = calibration.summary.cameras["front"].models["pinhole"]
        # A few seconds of walking and a click on another corner now and then: near, no more can be asked.
        assert found.polished.rms_px < 30
        check_bytes(owner, recording.id, bag, tmp_path)
    check_store(fleet)


def check_bytes(owner: Client, recording_id: UUID, bag: Path, tmp_path: Path) -> None:
    """Uploads went straight into the store, and frames and the original come straight from it."""
    parts = owner._http.get(f"/recordings/{recording_id}/parts", Parts)
    assert parts.upload.parts == "presigned" and len(parts.items) == -(-bag.stat().st_size // (16 << 20))
    address = owner._http.get(f"/recordings/{recording_id}/cameras/front/frames/3/address", BlobAddress)
    image = owner.recordings.frame(recording_id, "front", 3)
    through = owner._http.send("GET", f"/recordings/{recording_id}/cameras/front/frames/3").content
    assert image == through and image[:2] == b"\xff\xd8" and address.length == len(image)
    assert owner.recordings.download(recording_id, tmp_path / "back.bag") == bag.stat().st_size
    assert (tmp_path / "back.bag").read_bytes() == bag.read_bytes()


def check_store(fleet: ComposeFleet) -> None:
    """Every row has its object and every object its row; nobody gets at them without the address."""
    environment = fleet.environment_of("api")
    settings = Settings(**{name.removeprefix("APEXCAL_").lower(): value for name, value in environment.items()})
    database, store = Database(settings.database), open_store(settings)
    try:
        seen = audit(database, store, timedelta(seconds=-60), remove=False)
    finally:
        database.close()
    assert seen.objects >= 3 and seen.orphans == [] and seen.lost == []
    policy = httpx.get(f"{fleet.url}/").headers["content-security-policy"]
    assert store.origin in policy
    assert json.loads(httpx.get(f"{fleet.url}/readyz").text)["status"] == "ok"
