"""`apexcal copy`: asked for, waited for, downloaded, and the service's copy deleted."""

from __future__ import annotations

from typer.testing import CliRunner

from apexcal.cli import app
from apexcal.client import Client
from apexcal.documents.copies import CopyView
from tests.apexcal.conftest import Embedded
from tests.faults.jobs import LEVEL_RIG, SHORT, pairs
from tests.workers.readers.making_recordings import clouds, images, interleaved, png, write_bag
from tests.workers.readers.viewing.reading_viewer_files import messages
from workers.readers.detect import open_recording


def test_the_command_writes_the_copy(embedded: Embedded, owner: Client, tmp_path):
    fleet = owner.fleets.create("Copying")
    vehicle = owner.vehicles.create(fleet.id, "Tram")
    rig = owner.vehicles.create_rig(vehicle.id, LEVEL_RIG)
    of = owner.correspondence_sets.import_pairs(rig.id, "front", pairs(60)).id
    asked = owner.calibrations.create(vehicle.id, [of], ["pinhole"], folds=2, schedule=SHORT)
    calibration = owner.wait(asked, timeout_s=120)
    owner.calibrations.publish(
        calibration.summary.cameras["front"].models["pinhole"].result_id, "For the copy.", override=True
    )
    width, height = LEVEL_RIG["cameras"][0]["image_size"]
    frames = list(images(4, "/camera/compressed", png(width, height)))
    file = write_bag(tmp_path / "tram.bag", interleaved(clouds(4), frames))
    owner.wait(owner.recordings.upload(file, vehicle.id, rig.id), timeout_s=120)
    target = tmp_path / "out.bag"
    words = ["copy", "tram.bag", "-o", str(target), "--url", embedded.url, "--token", embedded.token]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.stderr + done.stdout
    assert "5 added" in done.stdout and "camera in velodyne" in done.stdout
    recording = open_recording(target)
    (camera,) = [one for one in recording.sensors if one.kind == "camera"]
    recording.close()
    current = owner.calibrations.current(vehicle.id, "front").intrinsics
    assert camera.camera_info["K"][0] == current.f_x
    (found,) = list(owner.recordings.list(vehicle_id=vehicle.id))
    assert list(owner.analyses.list(CopyView, recording_id=found.id)) == []
    assert CliRunner().invoke(app, words).exit_code == 2, "it is there already"
    viewers = tmp_path / "seen.mcap"
    done = CliRunner().invoke(app, [*words[:2], "-o", str(viewers), "--for-viewers", *words[4:]])
    assert done.exit_code == 0, done.stderr + done.stdout
    assert "8 as they were" in done.stdout and "camera in velodyne" in done.stdout
    ((_, _, flat), *_) = messages(viewers, "/front/undistorted/calibration")
    assert flat.P[0] == current.f_x
    refused = CliRunner().invoke(app, [*words, "--for-viewers", "--joint", "front=camera"])
    assert refused.exit_code == 2 and "--joint" in refused.stderr
