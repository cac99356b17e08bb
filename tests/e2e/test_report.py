"""A report in a browser: made by the button, looked at, points chosen in all plots, pairs left out."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Request, expect

from tests.e2e.conftest import SignIn, Track
from tests.e2e.looks import View, assert_looks, assert_verdict_at_once, each_view
from tests.e2e.test_calibrating import pairs_of_truth
from tests.faults.jobs import SHORT
from tests.workers.reports.material import EDGES, made
from workers.reports.contents import contents
from workers.reports.page import page as page_of

PLOTS = ("arrows", "offsets", "by_range", "by_angle", "over_time", "from_above")


@each_view
def test_a_report_is_read_and_pairs_are_left_out(sign_in: SignIn, track: Track, views: tuple[View, ...]) -> None:
    pairs = track.owner.correspondence_sets.import_pairs(track.rig_id, "front", pairs_of_truth(track, 60))
    done = track.owner.calibrations.create(track.vehicle_id, [pairs.id], ["pinhole"], folds=2, schedule=SHORT)
    done = track.owner.wait(done)
    assert done.summary
    result = str(done.summary.cameras["front"].models["pinhole"].result_id)
    tested = track.owner.analyses.validate_on_pairs(pairs.id, result_id=result)
    track.owner.wait(tested)

    page = sign_in("Rita", "engineer")
    page.goto(f"{track.url}/vehicles/{track.vehicle_id}")
    listed = page.get_by_role("listitem").filter(has_text="pairs, front").first
    holds = "agrees.*The calibration holds on these pairs.*lie far from all others"
    expect(listed).to_contain_text(re.compile(holds, re.DOTALL))

    page.goto(f"{track.url}/calibrations/{done.id}")
    page.get_by_role("button", name="Make a report").click()
    opens = page.get_by_role("link", name=re.compile("Open the report: (pass|look|stop)"))
    with page.context.expect_page() as opened:
        opens.click()
    report = opened.value
    expect(report.get_by_role("heading", level=1)).to_contain_text("Calibration report: front of Van 7, pinhole")
    expect(report.get_by_role("heading", name="Other recordings")).to_be_visible()
    assert_looks(report, views)

    # By the keyboard, in one plot; chosen in all that have the pair.
    report.locator("#plot-by_range").press("ArrowRight")
    words = report.locator("#chosen-words")
    expect(words).to_have_text(re.compile(r"Pair \d+: "))
    number = report.locator("#plot-by_range .chosen").get_attribute("data-pairs") or ""
    for name in PLOTS:
        expect(report.locator(f"#plot-{name} .chosen")).to_have_attribute("data-pairs", number)
    # The page projects by itself what the solver projected.
    residual = track.owner.calibrations.result(result).residuals_px[int(number)]
    shown = re.search(r": ([\d.]+) px off", words.inner_text())
    assert shown and float(shown[1]) == pytest.approx(residual, abs=0.011)
    report.get_by_role("button", name="Leave them out").click()
    expect(words).to_have_text("1 to be left out.")
    report.get_by_role("link", name="Calibrate again without them").click()
    report.get_by_role("button", name="Calibrate again without 1 pair").click()
    expect(report).not_to_have_url(re.compile(str(done.id)))
    again = track.owner.calibrations.get(report.url.rpartition("/")[2].partition("?")[0])
    again = track.owner.wait(again)
    assert again.summary
    assert again.summary.cameras["front"].models["pinhole"].pairs == pairs.count - 1


def test_a_saved_report_opens_from_a_file_and_names_stay_text(browser: Browser, tmp_path: Path) -> None:
    """It asks for nothing, runs nothing of a name, and shows its numbers in light, dark and print."""
    material = made()
    document = contents(material)
    document["names"] |= {"vehicle": "<img src=x onerror=alert(1)></script><script>alert(2)</script>"}
    document["elsewhere"] = [EDGES | {"sentence": "<!--<script>"}]
    document["upper_corner"] = 1
    for outlier, corner in zip(document["result"]["outliers"], ("top", "right"), strict=False):
        outlier["pair"] |= {"frame_index": 7, "corner": corner}
    file = tmp_path / "report.html"
    file.write_text(page_of(document))
    context = browser.new_context(offline=True, accept_downloads=True)
    page = context.new_page()
    requests: list[Request] = []
    page.on("request", lambda request: requests.append(request))
    problems: list[object] = []
    page.on("pageerror", lambda error: problems.append(error))
    page.on("dialog", lambda dialog: (problems.append(dialog), dialog.dismiss()))
    page.goto(file.as_uri())
    expect(page.get_by_role("heading", level=1)).to_contain_text(document["names"]["vehicle"])
    expect(page.get_by_text("<!--<script>")).to_be_visible()
    for corner in ("upper left corner", "upper right corner"):
        expect(page.get_by_role("cell", name=f"frame 7, {corner}", exact=True)).to_be_visible()
    assert page.locator("script").count() == 2 and page.locator("img").count() == 0

    rings = [float(one.get_attribute("data-rms") or 0) for one in page.locator("#plot-by_angle .ring").all()]
    belongs = np.ones(222, bool)
    belongs[[outlier.index for outlier in material.result.outliers]] = False
    residuals = np.array(material.result.residuals_px)[belongs]
    assert len(rings) == 4 and np.mean(np.square(rings)) == pytest.approx(np.mean(residuals**2), rel=0.02)
    for name, count in {**dict.fromkeys(PLOTS, 222), "person-0": 111, "person-1": 222}.items():
        drawn = page.locator(f"#plot-{name} .points")
        assert sum(int(one.get_attribute("data-points") or 0) for one in drawn.all()) == count, name
        assert sum((one.get_attribute("d") or "").count("M") for one in drawn.all()) == count, name

    # The worst are chosen by the threshold, and left out by the command: a file does not know its service.
    worst = sorted(outlier.index for outlier in material.result.outliers if outlier.residual_px > 30)
    page.get_by_role("slider").fill("30")
    page.get_by_role("button", name="Choose them").click()
    page.keyboard.press("Delete")
    command = f"apexcal recalibrate {document['result']['id']} --leave-out {','.join(map(str, worst))}"
    expect(page.get_by_label("Command")).to_have_value(command)
    page.get_by_text("How it was computed").click()
    assert_looks(page)
    with page.expect_download() as saved:
        page.get_by_role("button", name="Save the numbers as JSON").click()
    assert json.loads(Path(saved.value.path()).read_text()) == document | {"pictures": {}}
    page.emulate_media(media="print")
    expect(page.get_by_label("Chosen pairs")).to_be_hidden()
    assert [request.url for request in requests if not request.url.startswith(("file:", "blob:"))] == []
    assert problems == []
    context.close()


def test_wrong_marks_are_seen_and_left_out_on_the_page(sign_in: SignIn, track: Track) -> None:
    """The page draws what the report draws; two clicks fit again without all pairs that do not belong."""
    wrong = (5, 17, 31)
    pairs = [pair | {"v": pair["v"] + 60.0 * (i in wrong)} for i, pair in enumerate(pairs_of_truth(track, 90))]
    made_of = track.owner.correspondence_sets.import_pairs(track.rig_id, "front", pairs)
    asked = {"models": ["brown_conrady"], "folds": 0, "schedule": SHORT, "outliers": "keep"}
    done = track.owner.wait(track.owner.calibrations.create(track.vehicle_id, [made_of.id], **asked))
    page = sign_in("Ines", "engineer")
    page.goto(f"{track.url}/calibrations/{done.id}")
    expect(page.get_by_role("table").filter(has_text="At 20 m")).to_be_visible()
    assert done.summary
    fitted = done.summary.cameras["front"].models["brown_conrady"]
    result = track.owner.calibrations.result(fitted.result_id)
    assert_verdict_at_once(page, result.verdict, result.checks)
    page.get_by_text("Residuals of 90 pairs").click()
    page.get_by_label("Farther off than").fill("30")
    page.get_by_role("button", name="Choose them").click()
    for name in PLOTS:
        expect(page.locator(f"#plot-{name} .chosen")).to_have_attribute("data-pairs", ",".join(map(str, wrong)))
    assert_looks(page)
    page.get_by_role("button", name="Clear").click()
    page.get_by_role("button", name=re.compile("Leave out all")).click()
    page.get_by_role("button", name=re.compile(r"Calibrate again without \d+ pairs")).click()
    expect(page).not_to_have_url(re.compile(str(done.id)))
    again = track.owner.calibrations.get(page.url.rpartition("/")[2].partition("?")[0])
    again = track.owner.wait(again)
    fits = [one.summary.cameras["front"].models["brown_conrady"] for one in (done, again) if one.summary]
    outliers = track.owner.calibrations.result(fits[0].result_id).outliers
    assert set(wrong) <= {outlier.index for outlier in outliers}
    assert fits[1].pairs == 90 - len(outliers) and fits[1].polished.rms_px < fits[0].polished.rms_px
