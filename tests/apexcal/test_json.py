"""`--json` of every command prints one document. What is printed is read again, so that no reply is left unsaid."""

import csv
import importlib
import json
from pathlib import Path

from apexcal.cli import COMMANDS
from apexcal.client import Client
from apexcal.commands.session import Reply
from tests.apexcal.test_cli import apexcal
from tests.faults.jobs import LEVEL_RIG, pairs
from tests.support.served import Embedded

# Their document is one view, as `detect`'s; they need a walk with marks, one that failed or is published, or pages.
OF_ONE_VIEW = {"solve", "reread", "clock-offset", "copy", "report"}


def with_json() -> set[str]:
    """Commands that return a reply, whose session adds `--json`."""
    named = {name: importlib.import_module(f"apexcal.commands.{each.module}") for name, each in COMMANDS.items()}
    runs = {name: getattr(module, name.replace("-", "_")) for name, module in named.items()}
    return {name for name, run in runs.items() if run.__annotations__.get("return") in (Reply, "Reply")}


def test_json_of_every_command_is_one_document(embedded: Embedded, owner: Client, simulated: Path, tmp_path: Path):
    said: dict[str, object] = {}

    def run(name: str, *words: object):
        ran = apexcal(name, *words, "--data", embedded.data, "--json")
        assert ran.returncode in (0, 4), ran.stderr
        said[name] = json.loads(ran.stdout)
        return said[name]

    walk, car = ("--fleet", "Documents", "--vehicle", "walk"), ("--fleet", "Documents", "--vehicle", "car")
    run("rig", simulated / "rig.json", *walk)
    recording = run("upload", simulated / "recording.bag", *walk)["id"]
    region = tmp_path / "region.json"
    run("suggest", recording, "--out", region)
    detection = run("detect", recording, "--region", region, "--detector", "tolerant")["id"]
    marks = run("marks", detection)
    assert marks["analysis"]["kind"] == "machine_marks" and isinstance(marks["marks"], list)

    (tmp_path / "rig.json").write_text(json.dumps(LEVEL_RIG))
    rig = run("rig", tmp_path / "rig.json", *car)["id"]
    rows = pairs(60)
    with (tmp_path / "pairs.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    vehicle = run("ls", "vehicles", "car", "--fleet", "Documents")[0]["vehicle_id"]
    of_pairs = ("--pairs", tmp_path / "pairs.csv", "--vehicle", vehicle, "--model", "pinhole", "--folds", 0)
    calibration = run("calibrate", *of_pairs)
    (model,) = calibration["summary"]["cameras"]["front"]["models"].values()
    again = run("recalibrate", model["result_id"], "--leave-out", "0,1")["summary"]["cameras"]["front"]["models"]
    why = ("--reason", "a test", "--override")
    for result in (model["result_id"], again["pinhole"]["result_id"]):
        run("publish", result, *why)
    run("rollback", "--reason", "a test", "--vehicle", vehicle)
    run("alias", "--vehicle", vehicle)
    run("compare", "--result", model["result_id"], "--with", again["pinhole"]["result_id"])
    of_car = next(iter(owner.correspondence_sets.list(rig))).id
    run("validate", "pairs", of_car, "--result", model["result_id"])
    run("calibrate-fleet", "--fleet", "Documents", "--dry-run")
    run("show", "calibration", calibration["id"])
    run("open", "calibration", calibration["id"])
    run("withdraw", "--reason", "a test", "--vehicle", vehicle)
    run("invite", "somebody", "--fleet", "Documents")
    run("token", "program", "--fleet", "Documents")
    run("rm", "recording", recording, "--yes")
    assert set(said) | OF_ONE_VIEW == with_json()
