"""`apexcal report` and `apexcal recalibrate`, against a service that calibrates."""

from __future__ import annotations

import json
import re

from typer.testing import CliRunner

from apexcal.cli import app
from apexcal.client import Client
from tests.faults.jobs import LEVEL_RIG, SHORT, pairs
from tests.support.reports import data_of
from tests.support.served import Embedded


def test_a_report_is_written_and_its_pairs_are_left_out(embedded: Embedded, tmp_path):
    with Client(embedded.url, embedded.token) as client:
        vehicle = client.vehicles.create(client.fleets.create("Reports").id, "Wagon")
        rig = client.vehicles.create_rig(vehicle.id, LEVEL_RIG)
        of = client.correspondence_sets.import_pairs(rig.id, "front", pairs(60)).id
        asked = client.calibrations.create(vehicle.id, [of], ["pinhole"], folds=2, schedule=SHORT)
        done = client.wait(asked)
        result = str(done.summary.cameras["front"].models["pinhole"].result_id)

        def apexcal(*words: str):
            return CliRunner().invoke(app, [*words, "--url", embedded.url, "--token", embedded.token])

        file = tmp_path / "front.html"
        wrote = apexcal("report", result, "-o", str(file))
        assert wrote.exit_code == 0 and "Its verdict" in wrote.output, wrote.output
        data = data_of(file.read_text())
        assert data["result"]["id"] == result and len(data["pairs"]["u"]) == 60
        # The checks of the service, word for word.
        checks = client.calibrations.result(result).checks
        assert data["result"]["checks"] == [check.model_dump(mode="json") for check in checks]
        tested = apexcal("validate", "pairs", str(of), "--result", result)
        assert tested.exit_code == 0 and re.match("(agrees|disagrees|unknown): ", tested.output), tested.output
        assert apexcal("report", result, "-o", str(file)).exit_code == 2
        again = apexcal("recalibrate", result, "--leave-out", "3,17", "--json")
        assert again.exit_code == 0, again.output
        assert json.loads(again.stdout)["summary"]["cameras"]["front"]["models"]["pinhole"]["pairs"] == 58
        assert apexcal("recalibrate", result, "--leave-out", "three").exit_code == 2
