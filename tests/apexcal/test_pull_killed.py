"""`apexcal pull`, killed before any line in each kind of trouble, leaves the last good file or the new one."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from hashlib import sha256

import pytest
from sqlalchemy import update

from service.platform.db.fleets import Rig, RigCamera
from tests.apexcal.test_pull import Car, cut_off
from tests.service.publications.given import another_rig
from tests.support.databases import one_database

pytestmark = one_database
NOBODY = "http://127.0.0.1:9"
KILLS = 6


class Trouble:
    """A car that pulled a good file. Its folder is restored before each killed pull."""

    def __init__(self, served, folder) -> None:
        self.folder, self.saved = folder / "car", folder / "saved"
        self.folder.mkdir()
        self.car = Car(served, self.folder)
        with self.car.api.database.writing() as session:
            session.execute(update(Rig).values(lidar_serial="L-1"))
            session.execute(update(RigCamera).values(serial="C-1"))
        assert self.car.pull().exit_code == 0
        self.good = self.digest()

    def digest(self) -> str:
        return sha256(self.car.file.read_bytes()).hexdigest()

    def fresh(self) -> str:
        """What a pull without trouble gives, beside the good file."""
        file = self.folder.parent / "fresh.json"
        assert self.car.pull("-o", str(file)).exit_code == 0
        return sha256(file.read_bytes()).hexdigest()

    def kill(self, *more: str, room: int = -1, url: str | None = None):
        shutil.rmtree(self.saved, ignore_errors=True)
        shutil.copytree(self.folder, self.saved)
        words = ["pull", "-o", str(self.car.file), "--token", self.car.viewer.token, "--url", url or self.car.url]
        words += ["--vehicle", str(self.car.rig.vehicle_id), "--timeout", "20", *more]
        killing = ["-m", "tests.apexcal.killed_pulls", str(self.folder), str(self.saved), str(KILLS), str(room)]
        ran = subprocess.run([sys.executable, *killing, *words], capture_output=True, text=True, check=False)
        assert ran.returncode == 0, ran.stderr
        said = json.loads(ran.stdout)
        assert said["lines"] > 50
        return said


@pytest.fixture
def trouble(served, tmp_path) -> Trouble:
    return Trouble(served, tmp_path)


def test_something_new_is_there_whole_or_not_at_all(trouble):
    trouble.car.publish()
    new = trouble.fresh()
    said = trouble.kill()
    assert said["found"] == sorted([[trouble.good, True], [new, True]])
    assert (said["exit_code"], said["there"]) == (0, new) and said["left_behind"] > 0


def test_a_half_written_file_is_fetched_again(trouble):
    trouble.car.file.write_bytes(trouble.car.file.read_bytes()[:1000])
    half = trouble.digest()
    said = trouble.kill()
    assert said["found"] == sorted([[half, False], [trouble.good, True]])
    assert (said["exit_code"], said["there"]) == (0, trouble.good)


def test_withdrawn(trouble):
    trouble.car.withdraw(trouble.car.viewer.get(trouble.car.history).json()["items"][0])
    said = trouble.kill()
    assert said["found"] == [[trouble.good, True]] and said["exit_code"] == 5


def test_a_swapped_sensor(trouble):
    said = trouble.kill("--serial", "front=C-2")
    assert said["found"] == [[trouble.good, True]] and said["exit_code"] == 6
    another_rig(trouble.car.api, trouble.car.rig, "roof 2", lidar_serial="L-2")
    said = trouble.kill()
    assert said["found"] == [[trouble.good, True]] and said["exit_code"] == 6


def test_the_network_is_gone(trouble):
    said = trouble.kill(url=NOBODY)
    assert said["found"] == [[trouble.good, True]] and said["exit_code"] == 3


def test_the_answer_is_cut_off_in_its_middle(trouble):
    trouble.car.publish()
    with cut_off(trouble.car.url) as url:
        said = trouble.kill("--timeout", "2", url=url)
    assert said["found"] == [[trouble.good, True]] and said["exit_code"] == 3
    assert trouble.car.pull().exit_code == 0 and trouble.digest() != trouble.good


@pytest.mark.parametrize("room", [0, 900])
def test_the_disk_is_full(trouble, room):
    """No room for the note, and room for the note but not for the file."""
    trouble.car.publish()
    said = trouble.kill(room=room)
    assert said["found"] == [[trouble.good, True]] and said["exit_code"] == 1
