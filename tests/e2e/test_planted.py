"""The verdict of each planted fault and its reason are seen at once: on the result's page and in its report."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser

from apexcal.documents.checks import Check, verdict_of
from tests.e2e.conftest import SignIn, Track
from tests.e2e.looks import assert_verdict_at_once
from tests.e2e.test_calibrating import pairs_of_truth
from tests.faults.jobs import SHORT
from tests.workers.reports.material import made
from workers.reports.contents import contents
from workers.reports.page import page as page_of

PLANTED: dict[str, Any] = json.loads(Path(__file__).with_name("planted.json").read_text())
# The longest reason and the most checks of both verdicts, and a doubt of the mount alone.
FEW = ("turned halfway", "lens of another camera", "decentring, kannala_brandt", "15 % on the hand", "worn tip")
each_fault = pytest.mark.parametrize(
    "names", [pytest.param(FEW, id="few"), pytest.param(PLANTED, marks=pytest.mark.slow, id="all")]
)


def with_fault(result: dict[str, Any], name: str) -> dict[str, Any]:
    """The result as if its pairs had the fault."""
    failing = PLANTED[name]
    names = {check["name"] for check in failing}
    passing = [check for check in result["checks"] if check["verdict"] == "pass" and check["name"] not in names]
    checks = [Check.model_validate(check) for check in (*failing, *passing)]
    return result | {
        "checks": [check.model_dump(mode="json") for check in checks],
        "verdict": verdict_of(checks, "mount_with_lens"),
        "verdict_alone": verdict_of(checks, "mount_alone"),
    }


@pytest.fixture(scope="module")
def report() -> dict[str, Any]:
    """The document of a report."""
    return contents(made())


@pytest.fixture(scope="module")
def fitted(track: Track) -> tuple[str, str]:
    """A calibration with a result."""
    pairs = track.owner.correspondence_sets.import_pairs(track.rig_id, "front", pairs_of_truth(track, 70))
    done = track.owner.calibrations.create(track.vehicle_id, [pairs.id], ["pinhole"], folds=0, schedule=SHORT)
    done = track.owner.wait(done)
    assert done.summary
    return str(done.id), str(done.summary.cameras["front"].models["pinhole"].result_id)


@each_fault
def test_every_fault_is_seen_on_the_page(
    sign_in: SignIn, track: Track, fitted: tuple[str, str], names: Iterable[str]
) -> None:
    calibration, result = fitted
    page = sign_in(f"Petra of {len([*names])}", "engineer")
    document = json.loads(track.owner.calibrations.result(result).model_dump_json())
    faulty = document
    page.route(f"**/v1/results/{result}", lambda route: route.fulfill(json=faulty))
    for name in names:
        faulty = with_fault(document, name)
        page.goto(f"{track.url}/calibrations/{calibration}")
        assert_verdict_at_once(page, faulty["verdict"], faulty["checks"])


@each_fault
def test_every_fault_is_seen_in_the_report(
    browser: Browser, report: dict[str, Any], tmp_path: Path, names: Iterable[str]
) -> None:
    context = browser.new_context(offline=True)
    page = context.new_page()
    for number, name in enumerate(names):
        faulty = with_fault(report["result"], name)
        file = tmp_path / f"{number}.html"
        file.write_text(page_of(report | {"result": faulty}))
        page.goto(file.as_uri())
        assert_verdict_at_once(page, faulty["verdict"], faulty["checks"])
    context.close()
