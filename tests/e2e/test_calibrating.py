"""From correspondences to a published calibration, and a fleet's calibrations in one request, in a browser."""

import re
from uuid import UUID

import cv2
import numpy as np
from playwright.sync_api import Page, Route, expect
from sqlalchemy import select

from service.platform.db.models import Calibration, CalibrationRun, Job
from service.platform.db.session import Database
from tests.e2e.conftest import SignIn, Track
from tests.e2e.looks import assert_verdict_at_once
from tests.faults.jobs import LEVEL_RIG, SHORT, SLOW, pairs
from tests.support.served import Embedded
from tests.support.work import lose_every_worker

NOISE_PX = 0.5
SHOW = """state => {
  Object.defineProperty(document, "visibilityState", { value: state, configurable: true });
  document.dispatchEvent(new Event("visibilitychange"));
}"""


def pairs_of_truth(track: Track, count: int) -> list[dict[str, float]]:
    """Points in front of the simulated camera and where its true parameters see them, with some noise."""
    rng = np.random.default_rng(5)
    lens, mount = track.truth["intrinsics"], track.truth["transform"]
    K = np.array([[lens["f_x"], 0, lens["c_x"]], [0, lens["f_y"], lens["c_y"]], [0, 0, 1.0]])
    D = np.array([lens[name] for name in ("k1", "k2", "k3", "k4", "k5")])
    xyz = rng.uniform((5, -4, -1.5), (25, 4, 1.5), (count, 3))
    rotation, _ = cv2.Rodrigues(np.array(mount["rotation"]["matrix"]))
    uv, _ = cv2.projectPoints(xyz, rotation, np.array(mount["translation_m"]), K, D)
    uv = uv.reshape(-1, 2) + rng.normal(0, NOISE_PX, (count, 2))
    inside = np.all((uv > 0) & (uv < np.array(track.image_size) - 1), axis=1)
    columns = np.column_stack([xyz, uv])[inside]
    return [dict(zip("xyzuv", map(float, row), strict=True)) | {"group": i % 5} for i, row in enumerate(columns)]


def test_who_publishes_what_is_no_good_is_asked_first(sign_in: SignIn, track: Track) -> None:
    vehicle, pairs_of_one = add_cart(track, "Sledge", 40, vertices=1)
    wanted = {"models": ["pinhole"], "folds": 0, "publish": "recommended", "schedule": SHORT}
    done = track.owner.wait(track.owner.calibrations.create(vehicle, [pairs_of_one], **wanted))
    page = sign_in("Rex", "reviewer")
    page.goto(f"{track.url}/vehicles/{vehicle}")
    calibration = page.get_by_role("row").last
    expect(calibration).to_contain_text(re.compile("not determined, stop"))
    calibration.get_by_role("link").click()
    publish = page.get_by_role("button", name="Publish for the vehicle")
    expect(publish).not_to_have_class(re.compile("primary"))
    result = track.owner.calibrations.result(done.summary.cameras["front"].models["pinhole"].result_id)
    checks = result.checks
    assert_verdict_at_once(page, result.verdict, result.checks)
    page.get_by_text(f"All {len(checks)} checks").click()
    rows = page.get_by_role("table").filter(has_text="Finding").locator("tbody tr")
    expect(rows).to_have_count(len(checks))
    shown = [[text.strip() for text in row.locator("td").all_text_contents()] for row in rows.all()]
    assert shown == [
        [
            check.title,
            check.verdict.replace("_", " "),
            f"{check.sentence} {check.remedy}" if check.verdict == "not_checked" else check.sentence,
        ]
        for check in checks
    ]
    publish.focus()
    page.keyboard.press("Enter")
    dialog = page.get_by_role("dialog", name="Give the vehicle this pinhole for front?")
    expect(dialog).to_contain_text("The corners all lie in one place")
    expect(dialog).to_contain_text("No pairs were held out")
    expect(dialog.get_by_role("button", name="Publish")).to_be_disabled()
    page.keyboard.press("Escape")
    expect(dialog).to_have_count(0)
    expect(publish).to_be_focused()
    expect(page.get_by_text("None published yet.")).to_be_visible()
    publish.press("Enter")
    dialog.get_by_role("textbox").press_sequentially("A first guess,\nfor the demo.")
    expect(dialog.get_by_role("button", name="Publish")).to_be_enabled()
    for _ in range(2):
        page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    expect(page.get_by_text("Published: the current calibration")).to_be_visible()
    expect(page.get_by_text("A first guess, for the demo.")).to_be_visible()
    override = track.owner.calibrations.current(vehicle, "front").override
    assert override and override.reason == "A first guess, for the demo." and len(override.sentences) >= 2


def test_a_reviewer_goes_back_on_the_vehicles_page(sign_in: SignIn, track: Track) -> None:
    """With the keyboard alone: from the list of what the camera was given to what it had before."""
    vehicle, pairs_of_one = add_cart(track, "Wagon", 60)
    wanted = {"models": ["pinhole"], "folds": 3, "publish": "recommended", "schedule": SHORT}
    first, second = (
        track.owner.wait(track.owner.calibrations.create(vehicle, [pairs_of_one], seed=seed, **wanted))
        for seed in (1, 2)
    )
    page = sign_in("Bea", "reviewer")
    page.goto(f"{track.url}/vehicles/{vehicle}")
    expect(page.get_by_text("It was recommended and passed its checks.")).to_be_visible()
    page.get_by_text("All publications").focus()
    page.keyboard.press("Enter")
    again = page.get_by_role("button", name=re.compile("Publish again"))
    expect(again).to_have_count(1)
    again.focus()
    page.keyboard.press("Enter")
    dialog = page.get_by_role("dialog")
    expect(dialog).to_contain_text("Another calibration became the vehicle's current one")
    dialog.get_by_role("textbox").fill("The second one is off.")
    # A stream of hints that opens again has the objections read again. What was read stays until then.
    held: list[Route] = []
    page.route(re.compile(r"/v1/results/[^/]+$"), lambda route: held.append(route), times=1)
    with page.expect_request(re.compile(r"/v1/results/[^/]+$")):
        for state in ("hidden", "visible"):
            page.evaluate(SHOW, state)
    expect(dialog.get_by_role("button", name="Publish")).to_be_enabled()
    dialog.get_by_role("button", name="Publish").press("Enter")
    held[0].continue_()
    expect(dialog).to_have_count(0)
    expect(page.get_by_text("The second one is off.").first).to_be_visible()
    expect(page.get_by_role("listitem").filter(has_text=re.compile("by Bea.*current"))).to_be_visible()
    given = [one.calibration_id for one in track.owner.calibrations.publications(vehicle, "front")]
    assert given == [first.id, second.id, first.id]
    page.goto(f"{track.url}/calibrations/{first.id}")
    assert first.summary
    result = track.owner.calibrations.result(first.summary.cameras["front"].models["pinhole"].result_id)
    assert result.verdict != "stop"
    assert_verdict_at_once(page, result.verdict, result.checks)


def add_cart(track: Track, name: str, count: int, vertices: int | None = None) -> tuple[str, str]:
    """A vehicle with this many pairs, of so many vertices; its id and that of its set."""
    vehicle = track.owner.vehicles.create(track.fleet_id, name)
    rig = track.owner.vehicles.create_rig(vehicle.id, LEVEL_RIG)
    made = track.owner.correspondence_sets.import_pairs(
        rig.id, "front", pairs(vertices or count) * (count // (vertices or count))
    )
    return str(vehicle.id), str(made.id)


def jobs_of(database: Database, vehicle_id: str) -> list[int]:
    """The waiting jobs of a vehicle's calibrations."""
    with database.reading() as session:
        return list(
            session.scalars(
                select(Job.id)
                .join(CalibrationRun, CalibrationRun.id == Job.subject_id)
                .join(Calibration, Calibration.id == CalibrationRun.calibration_id)
                .where(Calibration.vehicle_id == UUID(vehicle_id), Job.state == "queued")
            )
        )


def ask_for_the_carts(page: Page, models: int, folds: int) -> None:
    """Fill in the form, look at what it would come to, and ask."""
    page.get_by_role("button", name="New fleet request").click()
    page.get_by_label("Vehicle's name").fill("lorry *")
    expect(page.get_by_role("group", name="Which vehicles").get_by_role("alert")).to_contain_text("matches none")
    expect(page.get_by_role("button", name="Calibrate")).to_be_disabled()
    page.get_by_label("Vehicle's name").fill("cart *")
    for box in page.get_by_role("group", name="What is fitted").get_by_role("checkbox").all()[models:]:
        box.uncheck()
    page.get_by_text("Options", exact=True).click()
    page.get_by_label("Folds").fill(str(folds))
    runs = 2 * models * (folds + 1)
    would = (
        f"3 vehicles match: 2 would be calibrated in {runs} runs (at most 1 processor minute); 1 would be skipped."
    )
    expect(page.get_by_role("status")).to_have_text(would)
    page.get_by_text("Who would be skipped").click()
    expect(page.get_by_text("front has 5 pairs")).to_be_visible()
    page.get_by_role("button", name="Calibrate 2 vehicles").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("Calibration of 2 vehicles")


def test_a_fleet_is_asked_for_and_one_vehicle_fails(sign_in: SignIn, track: Track, served: Embedded) -> None:
    first, first_set = add_cart(track, "Cart 1", 40)
    second, _ = add_cart(track, "Cart 2", 40)
    add_cart(track, "Cart 3", 5)
    # A fleet's jobs are sent oldest first. Until this is cancelled its hundreds stand before those of the carts.
    slow = track.owner.calibrations.create(
        first,
        [first_set],
        models=["pinhole"],
        folds=0,
        farm="slots",
        schedule=SLOW | {"slots": 500, "generations": 2000},
    )
    page = sign_in("Mia", "engineer")
    page.goto(f"{track.url}/fleets/{track.fleet_id}")
    page.get_by_role("link", name="Fleet requests").click()
    ask_for_the_carts(page, models=1, folds=0)
    database = Database(f"sqlite:///{served.data / 'apexcal.db'}")
    for job_id in jobs_of(database, second):
        lose_every_worker(database, job_id)
    database.close()
    track.owner.calibrations.cancel(slow.id)

    # Nobody reloads; and a vehicle that failed is an outcome, no alarm.
    expect(page.get_by_role("status")).to_have_text("1 done, 1 failed, 1 skipped.")
    expect(page.get_by_text("done with failures")).to_be_visible()
    expect(page.get_by_role("alert")).to_have_count(0)
    page.get_by_role("link", name="1 failed").click()
    expect(page.get_by_role("row")).to_have_count(2)
    expect(page.get_by_role("row").last).to_contain_text(
        re.compile("Cart 2.*worker died.*Ask for it again", re.DOTALL)
    )
    page.get_by_role("button", name="Calibrate 1 vehicle again").click()
    expect(page.get_by_role("status")).to_have_text("2 done, 1 skipped.")
    page.get_by_role("link", name="All 3").click()
    page.get_by_role("link", name="Calibration of Cart 2").click()
    expect(page.get_by_role("link", name="Cart 2")).to_be_visible()
    page.go_back()

    page.get_by_role("link", name="Test track: fleet requests").click()
    expect(page.get_by_role("row").last).to_contain_text(re.compile("Mia.*cart.*2 done, 1 skipped", re.DOTALL))
    ask_for_the_carts(page, models=3, folds=5)
    page.on("dialog", lambda asked: asked.accept())
    page.get_by_role("button", name="Cancel").click()
    expect(page.get_by_role("status")).to_have_text(re.compile("[12] cancelled, 1 skipped"))


def test_an_engineer_deletes_what_was_never_published(sign_in: SignIn, track: Track) -> None:
    vehicle, pairs_of_one = add_cart(track, "Discarded", 41)
    request = {"models": ["pinhole"], "folds": 0, "schedule": SHORT}
    calibration = track.owner.wait(track.owner.calibrations.create(vehicle, [pairs_of_one], **request))
    page = sign_in("Ada", "engineer")
    questions: list[str] = []
    page.goto(f"{track.url}/calibrations/{calibration.id}")
    # What cars would get is asked of the service before the question.
    with page.expect_event("dialog"):
        page.once("dialog", lambda dialog: dialog.dismiss())
        page.get_by_role("button", name="Delete", exact=True).click()
    expect(page.get_by_role("heading", level=1)).to_contain_text("Calibration of")
    page.on("dialog", lambda dialog: (questions.append(dialog.message), dialog.accept()))
    page.get_by_role("button", name="Delete", exact=True).click()
    expect(page.get_by_role("heading", level=1, name="Discarded")).to_be_visible()
    expect(page.get_by_role("heading", name="Calibrations")).to_have_count(0)
    rigs = page.locator("details").filter(has_text="LiDAR")
    rigs.locator("summary").first.press("Enter")
    rigs.get_by_role("button", name="Delete", exact=True).click()
    expect(page.get_by_text("A rig says which LiDAR and cameras")).to_be_visible()
    page.get_by_role("button", name="Delete", exact=True).click()
    expect(page).to_have_url(f"{track.url}/fleets/{track.fleet_id}")
    assert len(questions) == 3 and '"Discarded"' in questions[2]
    assert vehicle not in [str(one.id) for one in track.owner.vehicles.list(track.fleet_id)]
