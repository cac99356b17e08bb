"""The LiDAR's points in a browser that draws by software: shown, turned, picked, without a mouse, without WebGL."""

import re

import numpy as np
import pytest
from playwright.sync_api import Locator, Page, expect

from apexcal.sweeps import Points, unpack
from tests.e2e.conftest import SignIn, Track
from tests.e2e.dense import write_dense
from tests.e2e.looks import PHONE, assert_accessible, assert_fits, show
from tests.faults.jobs import SHORT, pairs
from tests.support.uploads import RIG

# A machine of two cores shows the sweep after 0.15 s, an overlay sooner, and half as many pictures as an idle page.
MOST_SECONDS = 2.0
SHARE_OF_IDLE = 0.25

SHOW = """async (number) => {
  const range = document.querySelector("[aria-label=Sweep]");
  const begun = performance.now();
  range.value = number;
  range.dispatchEvent(new Event("input", { bubbles: true }));
  const stage = document.querySelector("[data-sweeps]");
  const next = () => new Promise(requestAnimationFrame);
  while (stage.dataset.sweeps !== String(number)) await next();
  const before = stage.dataset.pictures;
  while (stage.dataset.pictures === before) await next();
  return (performance.now() - begun) / 1000;
}"""
# From a click on how an overlay is drawn until its canvas is on the screen, seconds.
DRAW = """async (name) => {
  const overlay = document.querySelector("section[aria-labelledby=overlay]");
  const canvas = overlay.querySelector("canvas");
  const before = canvas.dataset.points;
  const button = [...overlay.querySelectorAll("button")].find((one) => one.textContent === name);
  const begun = performance.now();
  button.click();
  while (canvas.dataset.points === before) await new Promise(requestAnimationFrame);
  await new Promise(requestAnimationFrame);
  return (performance.now() - begun) / 1000;
}"""
IDLE = """async (seconds) => {
  const begun = performance.now();
  let count = 0;
  for (; performance.now() - begun < 1000 * seconds; count += 1) await new Promise(requestAnimationFrame);
  return count / seconds;
}"""
TURN = """async (seconds) => {
  const stage = document.querySelector("[data-sweeps]");
  const [first, begun] = [Number(stage.dataset.pictures), performance.now()];
  while (performance.now() - begun < 1000 * seconds) {
    stage.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowRight", bubbles: true }));
    await new Promise(requestAnimationFrame);
  }
  return ((Number(stage.dataset.pictures) - first) / (performance.now() - begun)) * 1000;
}"""


@pytest.fixture(scope="module")
def dense(track: Track, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The id of a recording with sweeps of 100,096, 100,096 and 300,032 points."""
    vehicle = track.owner.vehicles.create(track.fleet_id, "Roof 128")
    rig = track.owner.vehicles.create_rig(vehicle.id, RIG)
    file = write_dense(tmp_path_factory.mktemp("dense") / "dense.bag", *RIG["cameras"][0]["image_size"])
    recording = track.owner.wait(track.owner.recordings.upload(file, vehicle.id, rig.id))
    assert sum(sweep.points for sweep in track.owner.recordings.sweeps(recording.id)) == 500_224
    return str(recording.id)


def open_points(page: Page, track: Track, recording_id: str) -> Locator:
    """The page of a recording, once its points are drawn: the part that takes keys."""
    page.goto(f"{track.url}/recordings/{recording_id}?step=facts")
    stage = page.get_by_role("application")
    expect(stage).to_have_attribute("data-pictures", re.compile("[1-9]"))
    expect(stage).to_have_attribute("data-sweeps", re.compile("[0-9]"))
    return stage


def points_of(track: Track, recording_id: str, index: int) -> Points:
    return unpack(track.owner.recordings.sweep(recording_id, index))


def said(page: Page) -> tuple[float, float, float]:
    """The coordinates of the point that was asked for, as the page says them."""
    status = page.get_by_role("region", name="LiDAR").get_by_role("status")
    expect(status).to_contain_text("x ")
    found = re.search(r"x (-?[\d.]+), y (-?[\d.]+), z (-?[\d.]+) m", status.inner_text())
    assert found, status.inner_text()
    return (float(found[1]), float(found[2]), float(found[3]))


def test_large_sweeps_come_at_once_and_turn_smoothly(sign_in: SignIn, track: Track, dense: str) -> None:
    page = sign_in("Iris", "viewer")
    stage = open_points(page, track, dense)
    expect(stage).to_have_attribute("data-points", "100096")
    ready = page.evaluate(SHOW, 1)
    assert ready < MOST_SECONDS, ready
    page.evaluate(SHOW, 2)
    expect(stage).to_have_attribute("data-points", "300032")
    # The best of some looks: other work on the machine slows a single one.
    looks = [(page.evaluate(TURN, 1), page.evaluate(IDLE, 1))]
    while looks[-1][0] < SHARE_OF_IDLE * looks[-1][1] and len(looks) < 10:
        looks.append((page.evaluate(TURN, 1), page.evaluate(IDLE, 1)))
    pictures, idle = looks[-1]
    print(f"100,096 points after {ready:.3f} s; 300,032 at {pictures:.1f} pictures a second, nothing at {idle:.1f}")
    assert pictures > SHARE_OF_IDLE * idle, looks


def test_the_overlay_of_a_large_sweep_is_drawn_at_once(sign_in: SignIn, track: Track, dense: str) -> None:
    owner, recording = track.owner, track.owner.recordings.get(dense)
    made = owner.correspondence_sets.import_pairs(recording.rig_id, RIG["cameras"][0]["name"], pairs(60))
    asked = {"models": ["pinhole"], "folds": 0, "schedule": SHORT}
    calibration = owner.wait(owner.calibrations.create(recording.vehicle_id, [made.id], **asked))
    page = sign_in("Zita", "reviewer")
    page.goto(f"{track.url}/calibrations/{calibration.id}")
    expect(page.get_by_role("region", name="Points in the frame").locator("canvas")).to_be_visible()
    took: list[float] = [page.evaluate(DRAW, name) for name in ("Nominal mount", "Frame alone") * 6]
    drawn = sorted(took[::2])
    print(f"overlay of a sweep of 100,096 points, s: {[round(one, 3) for one in drawn]}")
    assert drawn[len(drawn) // 2] < MOST_SECONDS


def test_a_picked_point_is_one_of_the_sweep(sign_in: SignIn, track: Track, dense: str) -> None:
    page = sign_in("Jo", "annotator")
    stage = open_points(page, track, dense)
    points = points_of(track, dense, 0)
    box = stage.bounding_box()
    assert box
    for across, down in ((0.5, 0.5), (0.4, 0.6)):
        page.mouse.click(box["x"] + across * box["width"], box["y"] + down * box["height"])
        assert np.abs(points.xyz - said(page)).max(axis=1).min() <= 0.00051
        page.keyboard.press("Escape")
    for view in PHONE:
        show(page, view)
        assert_accessible(page, "section[aria-labelledby=sweeps]")
    assert_fits(page)


def test_everything_is_done_by_keys(sign_in: SignIn, track: Track, dense: str) -> None:
    page = sign_in("Kim", "viewer")
    stage = open_points(page, track, dense)
    stage.focus()
    views = page.get_by_role("group", name="View")
    for key, name in (("t", "Top"), ("f", "Front"), ("s", "Side"), ("l", "LiDAR"), ("o", "Orbit")):
        page.keyboard.press(key)
        expect(views.get_by_role("button", pressed=True)).to_have_text(name)
    for key in ("ArrowLeft", "ArrowUp", "Shift+ArrowLeft", "+", "-", "0"):
        before = int(stage.get_attribute("data-pictures") or 0)
        page.keyboard.press(key)
        expect(stage).not_to_have_attribute("data-pictures", str(before))
    # As the LiDAR looks, the middle of the room is in the middle of the picture.
    before = int(stage.get_attribute("data-pictures") or 0)
    page.keyboard.press("f")
    expect(stage).not_to_have_attribute("data-pictures", str(before))
    page.keyboard.press("Enter")
    assert abs(said(page)[1]) < 0.3
    for name in ("ring", "range", "intensity", "height"):
        before = int(stage.get_attribute("data-pictures") or 0)
        page.get_by_label("Colour").select_option(name)
        if name != "height":
            expect(stage).not_to_have_attribute("data-pictures", str(before))
    slider = page.get_by_role("slider", name="Sweep", exact=True)
    slider.focus()
    page.keyboard.press("ArrowRight")
    expect(stage).to_have_attribute("data-sweeps", "1")
    page.get_by_label("many at once").check()
    expect(stage).to_have_attribute("data-points", "100096")  # of 300,032 there is room for one


def test_a_small_sensors_sweeps_are_shown_over_one_another(sign_in: SignIn, track: Track) -> None:
    page = sign_in("Lea", "viewer")
    stage = open_points(page, track, track.recording_id)
    page.get_by_label("many at once").check()
    expect(stage).to_have_attribute("data-sweeps", re.compile(r"^\d+( \d+){29}$"))
    shown = [int(one) for one in (stage.get_attribute("data-sweeps") or "").split()]
    counts = {one.index: one.points for one in track.owner.recordings.sweeps(track.recording_id)}
    assert int(stage.get_attribute("data-points") or 0) == sum(counts[index] for index in shown)


def test_without_webgl_the_page_says_so_and_works(sign_in: SignIn, track: Track, dense: str) -> None:
    page = sign_in("Nina", "viewer")
    page.add_init_script("""
        const original = HTMLCanvasElement.prototype.getContext;
        HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
            return kind.startsWith("webgl") ? null : original.call(this, kind, ...rest);
        };
    """)
    page.goto(f"{track.url}/recordings/{dense}?step=facts")
    lidar = page.get_by_role("region", name="LiDAR")
    expect(lidar.get_by_text("This browser cannot show points in 3D.")).to_be_visible()
    expect(lidar.get_by_role("status")).to_contain_text("100,096 points in 128 rings")
    expect(page.get_by_role("heading", name="front")).to_be_visible()
