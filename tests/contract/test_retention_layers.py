"""What a recording has goes layer by layer; pairs, results and publications stay."""

from concurrent.futures import ThreadPoolExecutor
from uuid import UUID

import pytest
from sqlalchemy import select, update

from service.platform.db.clock import now
from service.platform.db.models import Blob, CorrespondenceSet, Fleet, Recording, Result
from service.platform.db.session import Database
from service.platform.http.problems import conflict
from service.platform.jobs.reaper import reap
from service.recordings import retention
from service.recordings.actions import delete_set
from service.recordings.retention import delete_old_imports, delete_overdue, remove_old_layers
from tests.faults.jobs import pairs
from tests.support.asking import ask_calibration, bring_pairs
from tests.support.databases import wait_until_one_waits
from tests.support.uploads import RIG, new_recording, new_vehicle, upload
from tests.support.work import work
from tests.workers.readers.making_recordings import clouds, images, interleaved, png, write_bag

_DAY_S = 86400.0
_QUICK = {
    "models": ["pinhole"], "folds": 0,
    "schedule": {"population": 64, "generations": 6, "max_iterations": 2, "slots": 1},
}  # fmt: skip


def set_days(database: Database, **days: int) -> None:
    with database.writing() as session:
        session.execute(update(Fleet).values(retention=days))


def test_images_go_before_sweeps_and_both_say_so(context, tmp_path, engineer):
    fleet = engineer.get("/me").json()["fleets"][0]["id"]
    bag = write_bag(tmp_path / "one.bag", interleaved(clouds(), images(data=png(1280, 720))))
    path = f"/recordings/{new_recording(engineer, fleet)['id']}"
    upload(engineer, path.rpartition("/")[2], [bag.read_bytes()])
    work(context)

    def answers() -> list[tuple[int, str | None]]:
        asked = (f"{path}/original", f"{path}/cameras/front/frames/0", f"{path}/sweeps/0")
        got = [engineer.get(address) for address in asked]
        return [(one.status_code, one.json()["code"] if one.is_error else None) for one in got]

    assert answers() == [(200, None)] * 3
    set_days(context.database, original=3, images=10, sweeps=300)
    assert remove_old_layers(context.database) == 0
    with context.database.writing() as session:
        session.execute(update(Recording).values(created_at=now(-20 * _DAY_S)))
    assert remove_old_layers(context.database) == 1 and remove_old_layers(context.database) == 0
    gone = (410, "retention_ended")
    assert answers() == [gone, gone, (200, None)]
    with context.database.writing() as session:
        session.execute(update(Recording).values(created_at=now(-400 * _DAY_S)))
    assert remove_old_layers(context.database) == 1
    assert answers() == [gone] * 3
    found = engineer.get(path).json()
    assert found["state"] == "ready" and "original, images, sweeps" in found["warnings"][-1]
    assert engineer.get(f"/fleets/{fleet}").json()["taken_bytes"] == 0
    reap(context.database, context.store)
    with context.database.reading() as session:
        assert session.scalars(select(Blob.key)).all() == ["expired"], "and their rows"
    assert engineer.delete(path).status_code == 204


def test_old_imports_go_but_for_what_was_published(context, engineer):
    fleet = engineer.get("/me").json()["fleets"][0]["id"]
    van = new_vehicle(engineer, fleet)
    old, published = (bring_pairs(engineer, van["rig"], pairs(60, seed)) for seed in (1, 2))
    for pair_set in (old, published):
        calibration = ask_calibration(engineer, van["vehicle"], pair_set, **_QUICK)
    work(context)
    with context.database.reading() as session:
        result = session.scalars(select(Result.id).where(Result.calibration_id == UUID(calibration))).one()
    answer = engineer.post(f"/results/{result}/publication", {"override": {"reason": "Measured by hand."}})
    assert answer.is_success, answer.text
    set_days(context.database, pairs=30)
    assert delete_old_imports(context.database) == 0
    with context.database.writing() as session:
        for table in (CorrespondenceSet, retention.CalibrationRun):
            session.execute(update(table).values(created_at=now(-40 * _DAY_S)))
    assert delete_old_imports(context.database) == 1 and delete_old_imports(context.database) == 0
    with context.database.reading() as session:
        assert [str(id) for id in session.scalars(select(CorrespondenceSet.id))] == [published]


@pytest.mark.parametrize("round_of", [remove_old_layers, delete_old_imports, delete_overdue])
def test_what_is_spared_while_a_round_waits_for_it_stays(context, engineer, round_of):
    fleet = engineer.get("/me").json()["fleets"][0]["id"]
    van = new_vehicle(engineer, fleet)
    bring_pairs(engineer, van["rig"], pairs(20))
    set_days(context.database, original=3, pairs=3)
    with context.database.writing() as session:
        owned = {"fleet_id": UUID(fleet), "vehicle_id": UUID(van["vehicle"]), "rig_id": UUID(van["rig"])}
        session.add(Recording(**owned, name="walk", file_name="f", state="ready", retain_until=now(-1)))
        session.flush()
        for table in (CorrespondenceSet, Recording):
            session.execute(update(table).values(created_at=now(-40 * _DAY_S)))
    with ThreadPoolExecutor(1) as pool:
        with context.database.writing() as session:
            for table in (CorrespondenceSet, Recording):
                session.execute(select(table.id).with_for_update()).all()
            done = pool.submit(round_of, context.database)
            wait_until_one_waits(context.database)
            session.execute(update(Recording).values(retain_until=None))
            session.execute(update(Fleet).values(retention=None))
        assert done.result() == 0
    with context.database.reading() as session:
        assert session.execute(select(Recording.layers_gone, Recording.kept_until)).one() == (0, None)
        assert len(session.scalars(select(CorrespondenceSet.id)).all()) == 1


def test_one_that_cannot_go_keeps_no_other_fleets_from_it(context, api, monkeypatch):
    sets = []
    for number in range(2):
        fleet = api.fleet()
        engineer = api.member(fleet, "engineer")
        sets.append(bring_pairs(engineer, new_vehicle(engineer, fleet)["rig"], pairs(20, number)))
    set_days(context.database, pairs=3)
    with context.database.writing() as session:
        session.execute(update(CorrespondenceSet).values(created_at=now(-40 * _DAY_S)))
        first = session.scalars(select(CorrespondenceSet.id).order_by(CorrespondenceSet.fleet_id)).first()

    def refuse_first(session, row, is_due):
        if row.id == first:
            raise conflict("calibration_in_use", "It is in use.", "")
        return delete_set(session, row, is_due)

    monkeypatch.setattr(retention, "delete_set", refuse_first)
    assert delete_old_imports(context.database) == 1


def test_pairs_of_one_camera_stay_with_what_was_published_of_another(context, engineer, caplog):
    fleet = engineer.get("/me").json()["fleets"][0]["id"]
    vehicle = new_vehicle(engineer, fleet)["vehicle"]
    cameras = [
        camera | {"name": name, "frame": name, "nominal": camera["nominal"] | {"to_frame": name}}
        for camera in RIG["cameras"]
        for name in ("front", "left")
    ]
    rig = engineer.post(f"/vehicles/{vehicle}/rigs", RIG | {"name": "two", "cameras": cameras}).json()["id"]
    sets = [bring_pairs(engineer, rig, pairs(60, seed), camera["name"]) for seed, camera in enumerate(cameras)]
    calibration = ask_calibration(engineer, vehicle, *sets, **_QUICK)
    work(context)
    with context.database.writing() as session:
        of_left = (Result.calibration_id == UUID(calibration), Result.camera == "left")
        result = session.scalars(select(Result.id).where(*of_left)).one()
        for table in (CorrespondenceSet, retention.CalibrationRun):
            session.execute(update(table).values(created_at=now(-40 * _DAY_S)))
    answer = engineer.post(f"/results/{result}/publication", {"override": {"reason": "Measured by hand."}})
    assert answer.is_success, answer.text
    set_days(context.database, pairs=30)
    assert delete_old_imports(context.database) == 0
    assert "next round" not in caplog.text, "what must stay is not tried again in each round"
