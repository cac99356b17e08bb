"""What was never published is deleted with all that came from it; what is published keeps what it came from."""

from dataclasses import dataclass
from uuid import UUID

import pytest
from sqlalchemy import func, select, update

from service.platform.db.analyses import Analysis, AnalysisFile
from service.platform.db.annotations import Answer
from service.platform.db.calibrations import Calibration, CalibrationRun, CorrespondenceSet, Publication, Result
from service.platform.db.detections import Apex, Detection, Vertex
from service.platform.db.fleet_requests import FleetRequest, FleetRequestVehicle
from service.platform.db.fleets import Fleet, Rig, Vehicle
from service.platform.db.people import Membership
from service.platform.db.recordings import Blob, Recording
from tests.service.calibrations.test_results import DOCUMENT
from tests.service.detections.seeding import Seed, seed_answer, seed_marking
from tests.support.people import Api
from tests.support.rows import add

KINDS = ("calibrations", "detections", "rigs", "vehicles", "fleets")


@dataclass
class World:
    """A marked recording, a calibration of its pairs with a result, and a report of that with its file."""

    seed: Seed
    fleet: UUID
    calibration: UUID
    result: UUID

    def address(self, kind: str) -> str:
        ids = {
            "fleets": self.fleet, "vehicles": self.seed.vehicle_id, "rigs": self.seed.rig_id,
            "detections": self.seed.detection_id, "calibrations": self.calibration,
        }  # fmt: skip
        return f"/{kind}/{ids[kind]}"


def made(api: Api, fleet: UUID) -> World:
    seed = seed_marking(api.database, fleet)
    person = api.member(fleet, "annotator", f"marks in {fleet}")
    seed_answer(api.database, seed, person.person_id, 0, "confirmed", (10.0, 20.0))
    with api.database.writing() as session:
        detection = session.get_one(Detection, seed.detection_id)
        rig = session.get_one(Rig, seed.rig_id)
        of = {"recording_id": seed.recording_id, "detection_id": detection.id}
        pairs = add(session, CorrespondenceSet, rig, source="annotations", **of)
        calibration = add(session, Calibration, rig)
        run = add(session, CalibrationRun, calibration, pairs)
        result = add(session, Result, run, document=DOCUMENT)
        blob = add(session, Blob, key=f"reports/{result.id}")
        report = Analysis(
            fleet_id=fleet, vehicle_id=seed.vehicle_id, result_id=result.id, kind="report", asked={}, state="done"
        )
        session.add(report)
        session.flush()
        session.add(AnalysisFile(analysis_id=report.id, blob_key=blob.key, file_name="report.html"))
        return World(seed, fleet, calibration.id, result.id)


@pytest.fixture
def world(api: Api) -> World:
    return made(api, api.fleet("north"))


def count(api: Api, *tables: type) -> list[int]:
    with api.database.reading() as session:
        return [session.scalar(select(func.count()).select_from(table)) or 0 for table in tables]


def blob_states(api: Api) -> list[str]:
    with api.database.reading() as session:
        return sorted(session.scalars(select(Blob.state)))


def test_a_calibration_goes_with_its_results_and_their_files(api: Api, world: World) -> None:
    other = made(api, api.fleet("south"))
    engineer = api.member(world.fleet, "engineer")
    assert engineer.delete(world.address("calibrations")).status_code == 204
    assert count(api, Calibration, Result, Analysis, AnalysisFile) == [1, 1, 1, 1]
    assert count(api, CorrespondenceSet, Detection, Rig, Answer) == [2, 2, 2, 2]
    assert blob_states(api).count("condemned") == 1
    assert engineer.get(world.address("calibrations")).status_code == 404
    assert api.member(other.fleet, "viewer").get(other.address("calibrations")).status_code == 200


def test_a_detection_goes_with_its_pairs_and_the_marks_stay(api: Api, world: World) -> None:
    assert api.member(world.fleet, "engineer").delete(world.address("detections")).status_code == 204
    assert count(api, Detection, Vertex, CorrespondenceSet, Calibration, Result, AnalysisFile) == [0] * 6
    assert count(api, Recording, Answer, Apex)[:2] == [1, 1] and count(api, Apex) > [0]


def test_a_rig_goes_once_no_recording_has_it(api: Api, world: World) -> None:
    engineer = api.member(world.fleet, "engineer")
    refused = engineer.delete(world.address("rigs"))
    assert (refused.status_code, refused.json()["code"]) == (409, "rig_in_use") and "'walk'" in refused.text
    assert engineer.delete(f"/recordings/{world.seed.recording_id}").status_code == 204
    assert engineer.delete(world.address("rigs")).status_code == 204
    assert count(api, Rig, Vehicle) == [0, 1]


def test_a_vehicle_goes_with_everything_on_it(api: Api, world: World) -> None:
    made(api, api.fleet("south"))
    assert api.member(world.fleet, "engineer").delete(world.address("vehicles")).status_code == 204
    everything = (Vehicle, Rig, Recording, Detection, CorrespondenceSet, Calibration, Analysis, Answer)
    assert count(api, *everything) == [1] * 8
    # Two sensors' files and the report's.
    assert blob_states(api).count("condemned") == 3


def test_a_vehicle_of_a_running_fleet_request_stays(api: Api, world: World) -> None:
    with api.database.writing() as session:
        request = add(session, FleetRequest, session.get_one(Fleet, world.fleet))
        waiting = FleetRequestVehicle(fleet_request_id=request.id, vehicle_id=world.seed.vehicle_id, state="queued")
        session.add(waiting)
    engineer = api.member(world.fleet, "engineer")
    refused = engineer.delete(world.address("vehicles"))
    assert (refused.status_code, refused.json()["code"]) == (409, "fleet_request_running")
    with api.database.writing() as session:
        session.execute(update(FleetRequestVehicle).values(state="done"))
    assert engineer.delete(world.address("vehicles")).status_code == 204


def test_only_an_owner_deletes_a_fleet(api: Api, world: World) -> None:
    made(api, api.fleet("south"))
    refused = api.member(world.fleet, "admin").delete(world.address("fleets"))
    assert (refused.status_code, refused.json()["code"]) == (403, "owner_only")
    owner = api.owner()
    assert owner.delete(world.address("fleets")).status_code == 204
    assert [one["name"] for one in owner.get("/fleets").json()["items"]] == ["south"]
    assert count(api, Fleet, Vehicle, Calibration) == [1, 1, 1]
    with api.database.reading() as session:
        assert not session.scalars(select(Membership).where(Membership.fleet_id == world.fleet)).all()


@pytest.mark.parametrize("kind", KINDS)
def test_what_a_published_calibration_came_from_stays(api: Api, world: World, kind: str) -> None:
    with api.database.writing() as session:
        vehicle = session.get_one(Vehicle, world.seed.vehicle_id)
        add(session, Publication, vehicle, result_id=world.result, led_to=world.result)
        if kind == "rigs":
            # No recording stands in the way.
            other = add(session, Rig, vehicle, name="other")
            session.execute(update(Recording).values(rig_id=other.id))
    tables = (Fleet, Vehicle, Rig, Recording, Detection, CorrespondenceSet, Calibration, Result, Analysis, Answer)
    before = count(api, *tables)
    refused = api.owner().delete(world.address(kind))
    assert (refused.status_code, refused.json()["code"]) == (409, "calibration_in_use"), refused.text
    assert "current calibration of front" in refused.json()["detail"] and "withdraw" in refused.json()["hint"]
    assert count(api, *tables) == before and "condemned" not in blob_states(api)
