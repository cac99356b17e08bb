"""What an owner may say of a recording means the same to the service and to the readers."""

from dataclasses import fields
from typing import get_args, get_type_hints

import pytest

from apexcal.documents.readings import Reading
from tests.support.uploads import new_recording, upload
from tests.support.work import work
from tests.workers.readers.making_recordings import clouds, images, interleaved, png, write_bag
from workers.readers.recording import LidarModel, ReadOptions

FRONT, REAR = "/cam/a/image", "/cam/b/image"


def test_every_option_of_the_readers_can_be_said_and_nothing_else():
    assert set(Reading.model_fields) - {"topics"} == {field.name for field in fields(ReadOptions)}
    said = {
        "point_times": "stamp_only",
        "stamp_convention": "end",
        "rate_hz": 20.0,
        "lidar_model": "hdl32e",
        "rings": 32,
    }
    ReadOptions(**Reading.model_validate(said).model_dump(exclude={"topics"}))
    models = get_args(get_args(get_type_hints(Reading)["lidar_model"])[0])
    assert models == get_args(LidarModel)


@pytest.mark.usefixtures("broker")
def test_a_recording_that_asks_which_is_which_is_read_when_it_is_told(context, tmp_path, engineer):
    fleet = engineer.get("/me").json()["fleets"][0]["id"]
    bag = write_bag(
        tmp_path / "two.bag",
        interleaved(clouds(), images(topic=FRONT, data=png(1280, 720)), images(topic=REAR, data=png(1280, 720))),
    )
    made = new_recording(engineer, fleet)
    upload(engineer, made["id"], [bag.read_bytes()])
    work(context)
    path = f"/recordings/{made['id']}"
    failed = engineer.get(path)
    problem = failed.json()["problem"]
    assert problem["code"] == "ambiguous_cameras"
    assert {one["name"] for one in problem["candidates"]} == {FRONT, REAR}
    assert problem["cameras"] == ["front"]
    told = {"reading": {"topics": {"cameras": {"front": REAR}}}}
    assert engineer.patch(path, told, headers={"If-Match": failed.headers["etag"]}).status_code == 200
    assert engineer.post(f"{path}/retry").status_code == 202
    work(context)
    ready = engineer.get(path).json()
    assert (ready["state"], ready["problem"]) == ("ready", None)
    assert [sensor["topic"] for sensor in ready["sensors"] if sensor["kind"] == "camera"] == [REAR]
    assert ready["facts"]["together_s"] > 0
