"""Two results of a camera side by side, and a camera's results over time, in a browser."""

import re

import numpy as np
import pytest
from playwright.sync_api import expect

from apexcal.documents.results import ResultView
from tests.e2e.conftest import SignIn, Track
from tests.e2e.looks import View, assert_looks, each_view
from tests.faults.jobs import LEVEL_RIG, SHORT, pairs

MOVED_M = 0.06


@pytest.fixture(scope="module")
def results(track: Track) -> list[ResultView]:
    """One for the pairs of each seed, of a vehicle of their own. Before the last one the LiDAR moved 6 cm right."""
    owner = track.owner
    vehicle = owner.vehicles.create(track.fleet_id, "Drifter")
    rig = owner.vehicles.create_rig(vehicle.id, LEVEL_RIG)
    found: list[ResultView] = []
    for seed in (11, 12, 12, 13):
        seen = [pair | {"y": pair["y"] + MOVED_M * (seed == 13)} for pair in pairs(150, seed)]
        made = owner.correspondence_sets.import_pairs(rig.id, "front", seen)
        asked = owner.calibrations.create(vehicle.id, [made.id], ["pinhole"], folds=2, schedule=SHORT)
        done = owner.wait(asked)
        assert done.summary
        found.append(owner.calibrations.result(done.summary.cameras["front"].models["pinhole"].result_id))
    return found


@each_view
def test_two_results_are_compared_over_the_image(
    sign_in: SignIn, track: Track, results: list[ResultView], views: tuple[View, ...]
) -> None:
    first, *_, last = results
    page = sign_in("Cora", "viewer")
    page.goto(f"{track.url}/calibrations/{last.calibration_id}")
    page.get_by_text("Compare with", exact=True).click()
    # Without a current calibration the newest other one is compared; the oldest is chosen.
    beside = page.get_by_label("This result minus")
    beside.select_option(str(first.id))
    expect(page.get_by_text(re.compile(r"The mounts of front differ by .*more than chance\."))).to_be_visible()
    difference = np.array(last.transform.translation_m) - np.array(first.transform.translation_m)
    row = page.get_by_role("row").filter(has_text="t_x").filter(has_text="mm")
    assert abs(1e3 * difference[0] - 1e3 * MOVED_M) < 25, difference
    expect(row.first).to_contain_text(f"+{1e3 * difference[0]:.2f} mm")

    # One arrow for each point that both show at this distance, from the other one's pixel to this one's.
    assert first.field and last.field
    both = sorted(set(first.field.number) & set(last.field.number))
    near = [number for number in both if number < 612]  # 17 elevations of 36 azimuths each
    drawing = page.get_by_role("img", name=re.compile("Differences over the image at 5 m"))
    arrows = drawing.locator("g g")
    expect(arrows).to_have_count(len(near))
    said = arrows.first.locator("title").text_content() or ""
    here, there = last.field.number.index(near[0]), first.field.number.index(near[0])
    apart = np.hypot(last.field.u[here] - first.field.u[there], last.field.v[here] - first.field.v[there])
    assert said.strip().startswith(f"{apart:.2f} px apart at {round(last.field.u[here])}")
    # The shift of 6 cm is 500 * 0.06 / 5 px near, and a quarter of it far away.
    assert "more than chance" in (drawing.get_attribute("aria-label") or "")
    page.get_by_role("button", name="20 m").click()
    expect(page.get_by_role("img", name=re.compile("Differences over the image at 20 m"))).to_be_visible()
    assert_looks(page, views)
    page.get_by_role("button", name="all results over time").click()
    expect(page.get_by_text(re.compile("Over 4 results of front the mount moved"))).to_be_visible()


@each_view
def test_drift_is_drawn(sign_in: SignIn, track: Track, results: list[ResultView], views: tuple[View, ...]) -> None:
    vehicle = results[0].vehicle_id
    page = sign_in("Dora", "engineer")
    page.goto(f"{track.url}/vehicles/{vehicle}")
    expect(page.get_by_text(re.compile("Over 4 results of front the mount moved"))).to_be_visible()
    shifts = page.get_by_role("img", name=re.compile("shift from the first, mm, over time"))
    # Three lines of four results; the upright line is where the mount moved.
    expect(shifts.locator("circle.target")).to_have_count(12)
    expect(shifts.locator(".jump")).to_have_count(1)
    page.get_by_text("The numbers").click()
    drift = track.owner.calibrations.drift(vehicle, "front")
    last = drift.steps[-1].from_first
    assert last and last.shift_mm
    expect(page.get_by_role("row").nth(1)).to_be_visible()
    numbers = page.get_by_role("table").filter(has_text="From the one before").get_by_role("row").nth(1)
    expect(numbers).to_contain_text(f"{last.rotation_deg:.3f}°, {last.translation_mm:.1f} mm")
    ends = f"x ends at {last.shift_mm[0]:.1f}, y ends at {last.shift_mm[1]:.1f}, z ends at {last.shift_mm[2]:.1f}"
    assert ends in (shifts.get_attribute("aria-label") or "")
    assert_looks(page, views)
