"""`apexcal pull`: what comes of each kind of trouble, its exit code, and what then lies in the file."""

from __future__ import annotations

import json
import os

from sqlalchemy import update

from service.platform.db.calibrations import Result
from service.platform.db.fleets import RigCamera, RigLidar
from tests.service.calibrations.test_results import seed_results
from tests.service.publications.given import another_rig
from tests.support.databases import one_database

pytestmark = one_database


def test_it_is_replaced_when_something_is_published_and_only_then(car):
    assert car.pull().exit_code == 0
    first, at = car.kept(), car.file.stat().st_mtime_ns
    again = car.pull()
    assert again.exit_code == 0 and "has not changed" in again.stderr
    assert car.file.stat().st_mtime_ns == at, "nothing was written"
    second = car.publish()
    assert car.pull().exit_code == 0 and car.kept() == second != first
    whole = json.loads(car.file.read_text())
    assert whole["vehicle"] == "car" and whole["without"] == [] and whole["as_of"] is None
    assert whole["cameras"]["front"]["T_vehicle_camera"]["from_frame"] == "camera_front_optical"
    # A moment before the second: what it was given then.
    history = car.viewer.get(f"/vehicles/{car.rig.vehicle_id}/cameras/front/publications").json()["items"]
    assert car.pull("--as-of", history[1]["published_at"]).exit_code == 0
    assert car.kept() == first


def test_without_an_answer_the_last_file_stays(car):
    nobody = "http://127.0.0.1:9"
    assert car.pull(url=nobody).exit_code == 4 and not car.file.exists()
    assert car.pull().exit_code == 0
    good = car.file.read_bytes()
    gone = car.pull(url=nobody)
    assert gone.exit_code == 3 and "as it was pulled last" in gone.stderr and car.file.read_bytes() == good
    car.file.write_text("damaged")
    assert car.pull(url=nobody).exit_code == 4


def test_a_refusal_keeps_the_last_file_too(car):
    assert car.pull("--camera", "rear").exit_code == 4
    assert car.pull("--camera", "front").exit_code == 0
    good = car.file.read_bytes()
    refused = car.pull("--camera", "rear")
    assert refused.exit_code == 1 and "rear" in refused.stderr and car.file.read_bytes() == good
    assert car.pull("--token", "apx_wrong").exit_code == 1 and car.file.read_bytes() == good
    assert car.pull("-o", str(car.file.parent / "nowhere" / "x.json")).exit_code == 2


def test_another_programs_format(car):
    assert car.pull("--format", "openlabel").exit_code == 0
    systems = json.loads(car.file.read_text())["openlabel"]["coordinate_systems"]
    assert set(systems) == {"base", "velodyne", "camera_front_optical"}
    assert "has not changed" in car.pull("--format", "openlabel").stderr
    assert car.pull().exit_code == 0 and car.kept()
    with car.api.database.writing() as session:
        for row in session.query(Result).all():
            row.model = "kannala_brandt"
            row.document = row.document | {
                "intrinsics": row.document["intrinsics"] | {f"k{n}": 0.1 for n in range(1, 5)}
            }
    good = car.file.read_bytes()
    refused = car.pull("--format", "kitti")
    assert refused.exit_code == 1 and "kannala_brandt" in refused.stderr and car.file.read_bytes() == good


def test_what_was_withdrawn_keeps_the_last_file_and_says_so(car):
    first = car.viewer.get(car.history).json()["items"][0]
    assert car.withdraw(first) == 201
    none = car.pull()
    assert none.exit_code == 4 and "calibration_withdrawn" in none.stderr and not car.file.exists()
    second = car.publish()
    assert car.pull().exit_code == 0
    good = car.file.read_bytes()
    assert car.withdraw(car.viewer.get(car.history).json()["items"][0]) == 201
    gone = car.pull()
    assert gone.exit_code == 5 and car.file.read_bytes() == good
    assert "It pulls to the left" in gone.stderr and "as it was pulled last" in gone.stderr
    assert car.kept() == second
    third = car.publish()
    assert car.pull().exit_code == 0 and car.kept() == third


def test_a_swapped_sensor_keeps_the_last_file_and_says_so(car):
    with car.api.database.writing() as session:
        session.execute(update(RigLidar).values(serial="L-1"))
        session.execute(update(RigCamera).values(serial="C-1"))
    assert car.pull("--serial", "front=C-1", "--serial", "lidar=L-1").exit_code == 0
    good = car.file.read_bytes()
    swapped = car.pull("--serial", "front=C-2")
    assert swapped.exit_code == 6 and "C-1" in swapped.stderr and "C-2" in swapped.stderr
    assert car.file.read_bytes() == good
    another_rig(car.api, car.rig, "roof 2", lidar_serial="L-2")
    swapped = car.pull()
    assert swapped.exit_code == 6 and "'roof 2'" in swapped.stderr and car.file.read_bytes() == good
    assert car.pull("--serial", "front").exit_code == 1


def test_a_car_that_knows_its_name_or_a_sensor_and_no_id(car):
    with car.api.database.writing() as session:
        session.execute(update(RigLidar).values(serial="L-1"))
    for words in (("--vehicle", "car"), ("--sensor", "L-1"), ("--vehicle", "car", "--fleet", "fleet 1")):
        assert car.pull(*words).exit_code == 0 and car.kept()
        assert "has not changed" in car.pull(*words).stderr
    good = car.file.read_bytes()
    unknown = car.pull("--sensor", "L-2")
    assert unknown.exit_code == 1 and "no_such_vehicle" in unknown.stderr and car.file.read_bytes() == good


def test_an_alias_whose_result_was_deleted_keeps_the_last_file_and_says_so(car):
    _, (tried, _) = seed_results(car.api, car.rig)
    assert car.pull("--alias", "canary").exit_code == 4, "nothing is under it"
    assert car.reviewer.post(f"/results/{tried}/publication", {"alias": "canary"}).status_code == 201
    assert car.pull("--alias", "canary").exit_code == 0 and car.kept() == str(tried)
    good = car.file.read_bytes()
    with car.api.database.writing() as session:
        session.delete(session.get_one(Result, tried))
    gone = car.pull("--alias", "canary")
    assert gone.exit_code == 5 and "calibration_deleted" in gone.stderr and car.file.read_bytes() == good
    car.file.unlink()
    assert car.pull("--alias", "canary").exit_code == 4 and not car.file.exists()
    # The others are given as before.
    given = car.viewer.get(car.history).json()["items"][0]["result_id"]
    assert car.pull().exit_code == 0 and car.kept() == given


def test_a_full_disk_keeps_the_last_file_and_says_so(car, monkeypatch):
    """The writes of a kept file are killed and cut short at every place in `test_kept_file`."""
    assert car.pull().exit_code == 0
    good = car.file.read_bytes()
    car.publish()

    def full(descriptor):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(os, "fsync", full)
        ended = car.pull()
    assert ended.exit_code == 1 and "no space left" in ended.stderr and car.file.read_bytes() == good
    assert not list(car.file.parent.glob(".*.part"))
    assert car.pull().exit_code == 0 and car.file.read_bytes() != good
