"""A report in a browser: made by the button, looked at, points chosen in all plots, pairs left out."""

import re
from collections.abc import Callable

from playwright.sync_api import Page, expect

from tests.e2e.conftest import Track
from tests.e2e.looks import View, assert_looks, each_view
from tests.e2e.test_calibrating import pairs_of_truth
from tests.faults.jobs import SHORT

# The numbers of the pairs that are chosen in a plot.
CHOSEN = (
    """name => [...document.querySelectorAll(`[id="${name}-points"] .chosen`)].map(one => Number(one.dataset.pair))"""
)
PLOTS = ("arrows", "offsets", "by_range", "by_angle", "over_time", "ground-measured-pinhole")


@each_view
def test_a_report_is_read_and_pairs_are_left_out(
    sign_in: Callable[[str, str], Page], track: Track, views: tuple[View, ...]
) -> None:
    pairs = track.owner.correspondence_sets.import_pairs(track.rig_id, "front", pairs_of_truth(track, 60))
    done = track.owner.calibrations.create(track.vehicle_id, [pairs.id], ["pinhole"], folds=2, schedule=SHORT)
    done = track.owner.wait(done, timeout_s=90)
    assert done.summary
    result = str(done.summary.cameras["front"].models["pinhole"].result_id)
    tested = track.owner.analyses.validate_on_pairs(pairs.id, result_id=result)
    track.owner.wait(tested, timeout_s=60)

    page = sign_in("Rita", "engineer")
    page.goto(f"{track.url}/vehicles/{track.vehicle_id}")
    listed = page.get_by_role("listitem").filter(has_text="pairs, front").first
    holds = "agrees.*The calibration holds on these pairs.*lie far from all others"
    expect(listed).to_contain_text(re.compile(holds, re.DOTALL))

    page.goto(f"{track.url}/calibrations/{done.id}")
    page.get_by_role("button", name="Make a report").click()
    opens = page.get_by_role("link", name=re.compile("Open the report: (pass|look|stop)"))
    with page.context.expect_page() as opened:
        opens.click(timeout=60_000)
    report = opened.value
    expect(report.get_by_role("heading", level=1)).to_contain_text("Calibration report: front of Van 7, pinhole")
    expect(report.get_by_role("heading", name="Other recordings")).to_be_visible()
    assert_looks(report, views)

    # By the keyboard, in one plot; chosen in all that have the pair.
    report.locator("#plot-by_range").press("ArrowRight")
    words = report.locator("#chosen-words")
    expect(words).to_have_text(re.compile(r"Pair \d+: "))
    (number,) = report.evaluate(CHOSEN, "by_range")
    assert all(report.evaluate(CHOSEN, name) == [number] for name in PLOTS)
    report.get_by_role("button", name="Leave them out").click()
    expect(words).to_have_text("1 to be left out.")
    report.get_by_role("link", name="Calibrate again without them").click()
    report.get_by_role("button", name="Calibrate again without 1 pair").click()
    expect(report).not_to_have_url(re.compile(str(done.id)))
    again = track.owner.calibrations.get(report.url.rpartition("/")[2].partition("?")[0])
    again = track.owner.wait(again, timeout_s=90)
    assert again.summary
    assert again.summary.cameras["front"].models["pinhole"].pairs == pairs.count - 1
