"""A recording through the fleet of docker-compose.yml: its own commands and environment, as plain processes.

`test_rolling_restart.py` has the same fleet calibrate.
"""

import json
from datetime import timedelta
from pathlib import Path
from uuid import UUID

import httpx

from apexcal.client import Client
from apexcal.documents.recordings import BlobAddress, Parts
from apexcal.regions import read_region
from apexcal.rigs import read_rig
from service.platform.db.session import Database
from service.platform.settings import Settings
from service.platform.storage.audit import audit
from service.platform.storage.store import open_store
from tests.integration.fleet import APIS, WORKERS, ComposeFleet
from tests.support.asking import leave_marks_to_people
from tests.support.walks import walk

# What a loaded machine may need; an idle one takes a tenth of it.
PATIENCE_S = 150


def test_a_recording_goes_through_the_fleet_of_the_compose_file(fleet: ComposeFleet, tmp_path: Path) -> None:
    fleet.wait_until_healthy((*APIS, *WORKERS, "sweeper"), PATIENCE_S)
    folder = walk("plain")
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
        assert detection.counts.paired >= 10
        leave_marks_to_people(owner, recording.id)
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
