"""`apexcal publish`, `ls publications` and `rollback`, against a service that calibrates."""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass
from pathlib import Path

import pytest
from typer.testing import CliRunner

from apexcal.cli import app
from apexcal.client import ApiError, Client
from apexcal.documents.checks import Check
from tests.faults.jobs import LEVEL_RIG, SHORT, pairs
from tests.support.served import Embedded


@dataclass
class Car:
    """A vehicle, a result with its optimum on its bounds, and two that nothing speaks against."""

    service: Embedded
    id: str
    edge: str
    good: list[str]

    def apexcal(self, *words: str):
        return CliRunner().invoke(app, [*words, "--url", self.service.url, "--token", self.service.token])


@pytest.fixture(scope="module")
def car(embedded: Embedded) -> Car:
    with Client(embedded.url, embedded.token) as client:
        fleet = client.fleets.create("Publishing")
        vehicle = client.vehicles.create(fleet.id, "Wagon")
        rig = client.vehicles.create_rig(vehicle.id, LEVEL_RIG)
        of = client.correspondence_sets.import_pairs(rig.id, "front", pairs(200)).id
        asked = [
            client.calibrations.create(vehicle.id, [of], ["pinhole"], folds=2, schedule=SHORT, **request)
            for request in ({"bounds": {"f_x": [520.0, 700.0]}}, {"seed": 1}, {"seed": 2})
        ]
        edge, *good = [_result(client.wait(one)) for one in asked]
    return Car(embedded, str(vehicle.id), edge, good)


def _result(calibration):
    assert calibration.request.publish == "none"
    return str(calibration.summary.cameras["front"].models["pinhole"].result_id)


def test_one_click_does_not_publish_what_lies_on_its_bounds(car: Car, owner: Client):
    with pytest.raises(ApiError) as refused:
        owner.calibrations.publish(car.edge)
    assert (refused.value.status, refused.value.code) == (409, "checks_stop")
    assert any("f_x" in one["sentence"] and one["name"] == "bounds" for one in refused.value.fields["checks"])
    with pytest.raises(ApiError, match="Nothing has been published"):
        owner.calibrations.current(car.id, "front")


def test_the_commands_publish_list_and_go_back(car: Car, owner: Client):
    refused = car.apexcal("publish", car.edge)
    assert refused.exit_code == 1
    assert "edge of the bounds of f_x" in refused.stderr and "add --override" in refused.stderr
    given = car.apexcal("publish", car.edge, "--override", "--reason", "It leaves at noon.")
    assert given.exit_code == 0, given.stderr
    assert "pinhole is now the current calibration of front on Wagon." in given.stdout
    assert "Published although: " in given.stdout
    for result in car.good:
        published = car.apexcal("publish", result)
        assert published.exit_code == 0, published.stderr
    again = car.apexcal("publish", car.good[0])
    assert again.exit_code == 1 and "with --reason" in again.stderr
    back = car.apexcal("rollback", "--vehicle", car.id, "--reason", "The newer one is off.")
    assert back.exit_code == 0, back.stderr
    assert owner.calibrations.current(car.id, "front").reason == "The newer one is off."
    further = car.apexcal("rollback", "--vehicle", car.id, "--reason", "Further.")
    assert further.exit_code == 1 and "edge of the bounds" in further.stderr, "never to what was left"
    further = car.apexcal("rollback", "--vehicle", car.id, "--reason", "Further.", "--override")
    assert further.exit_code == 0, further.stderr
    none = car.apexcal("rollback", "--vehicle", car.id, "--reason", "Further.")
    assert none.exit_code == 1 and "had no result before" in none.stderr
    listed = car.apexcal("ls", "publications", "--vehicle", car.id).stdout.splitlines()
    results = [line.split("result ")[1] for line in listed if "result " in line and not line.startswith(" ")]
    assert results == [f"{car.edge}, current", car.good[0], car.good[1], car.good[0], car.edge]
    assert "  It leaves at noon." in listed
    owner.calibrations.publish(car.good[1], "For whoever comes next.")


def test_what_a_check_keeps_back_ends_the_command_with_4_and_is_what_the_service_says(
    embedded: Embedded, owner: Client, tmp_path: Path
):
    vehicle = owner.vehicles.create(owner.fleets.create("Kept back").id, "Cart")
    owner.vehicles.create_rig(vehicle.id, LEVEL_RIG)
    few = pairs(40)
    with (tmp_path / "pairs.csv").open("w") as file:
        table = csv.DictWriter(file, few[0].keys())
        table.writeheader()
        table.writerows(few)
    here = ["--url", embedded.url, "--token", embedded.token]
    words = ["calibrate", "--pairs", str(tmp_path / "pairs.csv"), "--vehicle", str(vehicle.id), "--model", "pinhole"]
    words += ["--folds", "0", "--publish", *here]
    uncalibrated = CliRunner().invoke(app, ["export", "--vehicle", str(vehicle.id), *here])
    assert uncalibrated.exit_code == 1 and "apexcal calibrate" in uncalibrated.stderr
    for more, said in (
        (("--seed", str(10**19)), "pairs of front, as the"),
        (("--camera", "nose"), "Its cameras are front"),
    ):
        refused = CliRunner().invoke(app, [*words, *more])
        assert refused.exit_code == 2 and said in refused.stderr, refused.output
    told = CliRunner().invoke(app, [*words, "--json"])
    assert told.exit_code == 4, told.stderr
    camera = json.loads(told.stdout)["summary"]["cameras"]["front"]
    assert camera["published"] is False
    checks = owner.calibrations.result(camera["models"]["pinhole"]["result_id"]).checks
    assert _said([Check.model_validate(one) for one in camera["checks"]]) == _said(checks)
    shown = CliRunner().invoke(app, words)
    assert shown.exit_code == 4, shown.stderr
    assert "Nothing was published for front on Cart: a check keeps it back." in shown.stdout
    failed = [one for one in checks if one.is_doubt]
    assert any(one.sentence.startswith("No pairs were held out") for one in failed)
    for check in failed:
        assert f"{check.sentence} {check.remedy}" in shown.stdout
    with pytest.raises(ApiError, match="Nothing has been published"):
        owner.calibrations.current(vehicle.id, "front")


def _said(checks: list[Check]) -> list[tuple[str, ...]]:
    return sorted((one.name, one.scope, one.verdict, one.sentence, one.remedy) for one in checks)
