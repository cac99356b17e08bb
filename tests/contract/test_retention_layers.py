"""What a recording has goes layer by layer; pairs, results and publications stay."""

from uuid import UUID

import pytest
from sqlalchemy import select, update

from service.platform.db.clock import now
from service.platform.db.models import Blob, CorrespondenceSet, Fleet, Recording, Result
from service.platform.db.session import Database
from service.platform.jobs.sweep import sweep
from service.recordings import retention
from service.recordings.retention import delete_old_imports, delete_overdue, remove_old_layers
from tests.faults.jobs import pairs
from tests.support.asking import ask_calibration, bring_pairs
from tests.support.uploads import new_recording, new_vehicle, upload
from tests.support.work import work
from tests.workers.readers.making_recordings import clouds, images, interleaved, png, write_bag

pytestmark = pytest.mark.usefixtures("broker")
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
    sweep(context.database, context.store)
    with context.database.reading() as session:
        assert session.scalars(select(Blob.key)).all() == ["expired"], "and their rows"
    assert engineer.delete(path).status_code == 204


def test_old_imports_go_but_for_what_was_published(context, engineer):
    """And what must stay is not tried again in each round."""
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
    # A recording that it came from.
    with context.database.writing() as session:
        named = session.scalars(select(CorrespondenceSet)).one()
        named = {name: getattr(named, name) for name in ("fleet_id", "vehicle_id", "rig_id")} | {"name": "walk"}
        row = Recording(**named, file_name="f", state="ready", retain_until=now(-1))
        session.add(row)
        session.flush()
        session.execute(update(CorrespondenceSet).values(recording_id=row.id))
    assert delete_overdue(context.database) == 0
    with context.database.writing() as session:
        assert session.scalars(select(Recording.kept_until)).one() > session.scalars(select(now(0.9 * _DAY_S))).one()
        session.execute(update(Recording).values(version=7))
    assert delete_overdue(context.database) == 0
    with context.database.reading() as session:
        assert session.scalars(select(Recording.version)).one() == 7
