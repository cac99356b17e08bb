"""A vehicle of a served service, and what its computer runs."""

from __future__ import annotations

import contextlib
import io
import json
import runpy
import sys
from pathlib import Path
from typing import NamedTuple

from apexcal.commands.pull import program_source
from tests.service.calibrations.test_results import T_VEHICLE_LIDAR, seed_results
from tests.service.detections.seeding import seed_rig
from tests.support.people import Actor


class Ended(NamedTuple):
    """How the program ended."""

    exit_code: int
    stderr: str


def run_program(file: Path, words: list[str]) -> Ended:
    """Run the program of `apexcal pull --program` in this process, where tests put a clock and a disk under it."""
    errors, before = io.StringIO(), sys.argv
    sys.argv = [str(file), *words]
    try:
        with contextlib.redirect_stderr(errors):
            runpy.run_path(str(file), run_name="__main__")
    except SystemExit as left:
        return Ended(left.code if isinstance(left.code, int) else 0, errors.getvalue())
    finally:
        sys.argv = before
    raise AssertionError("the program did not exit")


class Car:
    """A served vehicle with a published calibration, a file to keep it in, and the program that pulls it."""

    def __init__(self, served, folder) -> None:
        self.api, self.url = served
        self.program = folder.parent / "apexcal-pull.py"
        self.program.write_text(program_source())
        fleet = self.api.fleet()
        self.rig = seed_rig(self.api.database, fleet, T_vehicle_lidar=T_VEHICLE_LIDAR)
        self.reviewer: Actor = self.api.member(fleet, "reviewer")
        self.viewer: Actor = self.api.member(fleet, "viewer")
        self.file = folder / "calibration.json"
        self.publish()

    def publish(self) -> str:
        _, (result, _) = seed_results(self.api, self.rig)
        assert self.reviewer.post(f"/results/{result}/publication").status_code == 201
        return str(result)

    def pull(self, *more: str, url: str | None = None):
        words = ["-o", str(self.file), "--token", self.viewer.token, "--url", url or self.url, *more]
        return run_program(self.program, words)

    @property
    def history(self) -> str:
        return f"/vehicles/{self.rig.vehicle_id}/cameras/front/publications"

    def withdraw(self, publication) -> int:
        body = {"reason": "It pulls to the left"}
        return self.reviewer.post(f"/publications/{publication['id']}/withdrawal", body).status_code

    def kept(self) -> str:
        return json.loads(self.file.read_text())["cameras"]["front"]["result_id"]
