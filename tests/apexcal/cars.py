"""A vehicle of a served service, and what its computer runs."""

from __future__ import annotations

import json

from typer.testing import CliRunner

from apexcal.cli import app
from tests.service.calibrations.test_results import T_VEHICLE_LIDAR, seed_results
from tests.service.detections.seeding import seed_rig
from tests.support.people import Actor


class Car:
    """A served vehicle with a published calibration, and a file to keep it in."""

    def __init__(self, served, folder) -> None:
        self.api, self.url = served
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
        words = ["pull", "-o", str(self.file), "--token", self.viewer.token, "--url", url or self.url, *more]
        return CliRunner().invoke(app, words)

    @property
    def history(self) -> str:
        return f"/vehicles/{self.rig.vehicle_id}/cameras/front/publications"

    def withdraw(self, publication) -> int:
        body = {"reason": "It pulls to the left"}
        return self.reviewer.post(f"/publications/{publication['id']}/withdrawal", body).status_code

    def kept(self) -> str:
        return json.loads(self.file.read_text())["cameras"]["front"]["result_id"]
