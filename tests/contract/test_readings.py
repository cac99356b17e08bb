"""What an owner may say of a recording means the same to the service and to the readers."""

import pytest

from tests.support.uploads import new_recording, upload
from tests.support.work import work
from tests.workers.readers.making_recordings import clouds, images, interleaved, png, write_bag

FRONT, REAR = "/cam/a/image", "/cam/b/image"


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
