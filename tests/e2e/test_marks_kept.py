"""No placed or saved mark is lost or replaced in silence: offline, reload, Back, undo, tabs, other people."""

import os
from typing import Any

import pytest
from playwright.sync_api import Page, Route, expect

from tests.e2e.conftest import SignIn, Track
from tests.e2e.marking import Marker
from tests.e2e.test_marking import ask_marks

HAS_FRAMES = (
    r"count => performance.getEntriesByType('resource').filter((one) => /frames\/\d/.test(one.name)).length >= count"
)
OFFLINE = int(os.environ.get("OFFLINE", "12"))
SHOWS_ANOTHER = "vertex => document.querySelector('.stage')?.dataset.vertex !== vertex"


@pytest.fixture(autouse=True)
def everybody_gets_every_vertex(track: Track) -> None:
    """So that no test takes another one's vertices away."""
    ask_marks(track, 50)


def marker(sign_in: SignIn, track: Track, name: str) -> Marker:
    person = Marker(sign_in(name, "annotator"), track)
    person.open()
    return person


def wait_for_mark(person: Marker, vertex: str, pixel: tuple[float, float]) -> dict[str, Any]:
    """The stored mark of a vertex, which is the one that was placed."""
    mark: dict[str, Any] = {}
    for _ in range(600):
        mark = person.own_marks().get(vertex, {}).get("mark") or {}
        # Another answer may be stored until this one arrives.
        if mark and (mark["u"], mark["v"]) == pytest.approx(pixel, abs=0.51):
            return mark
        person.page.wait_for_timeout(100)
    raise AssertionError(f"the stored mark is {mark}, not at {pixel}")


def test_frames_ahead_are_marked_without_a_network(sign_in: SignIn, track: Track) -> None:
    gro = marker(sign_in, track, "Gro")
    # That which is shown, those that come, and two that the recording's page showed and fetched.
    gro.page.wait_for_function(HAS_FRAMES, arg=1 + OFFLINE + 2)
    gro.page.context.set_offline(True)
    given: dict[str, tuple[float, float]] = {}
    for turn in range(OFFLINE):
        before = gro.vertex
        given[before] = gro.click(0.4 + 0.2 * turn / OFFLINE, 0.4)
        gro.page.keyboard.press("Enter")
        gro.page.wait_for_function(SHOWS_ANOTHER, arg=before)
        gro.ready()
    assert len(given) == OFFLINE
    gro.page.context.set_offline(False)
    for vertex, placed in given.items():
        wait_for_mark(gro, vertex, placed)


def test_an_answer_given_offline_is_kept_and_sent(sign_in: SignIn, track: Track) -> None:
    hana = Marker(sign_in("Hana", "annotator"), track)
    asked: list[Route] = []

    def only_first(route: Route) -> None:
        """Two frames come ahead of the first one, and no more."""
        asked.append(route)
        route.continue_() if len(asked) == 1 else route.abort()

    hana.page.route("**/tasks/next", only_first)
    hana.open()
    vertex, placed = hana.vertex, hana.click(0.3, 0.4)
    hana.page.wait_for_function(HAS_FRAMES, arg=3)
    hana.page.context.set_offline(True)
    given = {vertex: placed}
    # Two more frames are there already.
    for turn in (1, 2):
        before = hana.vertex
        hana.page.keyboard.press("Enter")
        hana.page.wait_for_function(SHOWS_ANOTHER, arg=before)
        hana.ready()
        given[hana.vertex] = hana.click(0.3 + 0.1 * turn, 0.4)
    hana.page.keyboard.press("Enter")
    expect(hana.page.get_by_test_id("unsent")).to_contain_text("3 answers wait to be sent")
    hana.page.mouse.click(400, 400)
    expect(hana.page.get_by_text("Your answers wait here")).to_be_visible()
    assert (hana.vertex, hana.shown()) == (list(given)[-1], 1)
    hana.page.unroute("**/tasks/next")
    hana.page.context.set_offline(False)
    for vertex, placed in given.items():
        wait_for_mark(hana, vertex, placed)
    hana.ready()
    assert hana.vertex not in given
    expect(hana.page.get_by_test_id("unsent")).to_have_count(0)


def test_an_answer_that_waits_survives_the_page_and_is_sent_once(sign_in: SignIn, track: Track) -> None:
    ivo = marker(sign_in, track, "Ivo")
    vertex, placed = ivo.vertex, ivo.click(0.3, 0.4)

    def lose_the_answer(route: Any) -> None:
        route.fetch()  # the service has it, and the browser does not know
        route.abort()

    ivo.page.route("**/answer", lose_the_answer)
    ivo.page.keyboard.press("Enter")
    ivo.page.get_by_test_id("unsent").wait_for()
    context = ivo.page.context
    ivo.page.close()
    again = Marker(context.new_page(), track)
    again.open()
    assert again.vertex != vertex
    assert wait_for_mark(again, vertex, placed)["version"] == 1
    expect(again.page.get_by_test_id("unsent")).to_have_count(0)


def test_an_answer_that_waits_is_taken_back_before_it_is_sent(sign_in: SignIn, track: Track) -> None:
    jo = marker(sign_in, track, "Jo")
    vertex = jo.vertex
    jo.click(0.3, 0.4)
    jo.page.context.set_offline(True)
    jo.page.keyboard.press("Enter")
    jo.page.get_by_test_id("unsent").wait_for()
    jo.page.keyboard.press("z")
    jo.ready()
    assert (jo.vertex, jo.shown()) == (vertex, 1)
    jo.page.context.set_offline(False)
    placed = jo.click(0.6, 0.5)
    jo.save()
    wait_for_mark(jo, vertex, placed)


def test_undo_and_reload_show_the_mark_and_undo_works_after_a_reload(sign_in: SignIn, track: Track) -> None:
    lea = marker(sign_in, track, "Lea")
    vertex, placed = lea.vertex, lea.click(0.3, 0.4)
    lea.save()
    lea.reload()
    lea.undo()
    assert (lea.vertex, lea.shown()) == (vertex, 1)
    lea.reload()
    assert (lea.vertex, lea.shown()) == (vertex, 1)
    assert lea.own_marks() == {}
    lea.save()
    wait_for_mark(lea, vertex, placed)


@pytest.mark.parametrize(
    ("name", "choice", "first_stays"), [("Mia", "The saved one", True), ("Nils", "This one", False)]
)
def test_two_tabs_of_one_person_ask_which_answer_holds(
    sign_in: SignIn, track: Track, name: str, choice: str, first_stays: bool
) -> None:
    here = marker(sign_in, track, name)
    there = Marker(here.page.context.new_page(), track)
    there.open()
    vertex = here.vertex
    assert there.vertex == vertex
    first, second = here.click(0.3, 0.4), there.click(0.6, 0.6)
    here.save()
    there.page.keyboard.press("Enter")
    asked = there.page.get_by_test_id("refused")
    expect(asked).to_contain_text(f"{first[0]:.1f}")
    expect(asked).to_contain_text(f"{second[0]:.1f}")
    wait_for_mark(here, vertex, first)
    asked.get_by_role("button", name=choice).click()
    there.page.wait_for_function(SHOWS_ANOTHER, arg=vertex)
    there.ready()
    wait_for_mark(there, vertex, first if first_stays else second)
    assert there.page.get_by_test_id("refused").count() == 0


def test_a_click_right_after_enter_never_lands_on_the_next_vertex(sign_in: SignIn, track: Track) -> None:
    otto = marker(sign_in, track, "Otto")
    for pause in (0, 50, 100, 150):
        in_time = False
        while not in_time:  # a busy machine may pause for longer: then the next vertex has its turn
            vertex, placed = otto.vertex, otto.click(0.3, 0.4)
            # Within the page, so that the pause is the one that is meant.
            in_time = otto.page.evaluate(CLICK_AFTER_ENTER, pause)
            otto.page.wait_for_function(SHOWS_ANOTHER, arg=vertex)
            otto.ready()
            wait_for_mark(otto, vertex, placed)
            assert otto.shown() == 0
        expect(otto.page.get_by_text("was not used")).to_be_visible()


# Whether the click came before anybody can have seen the new frame, which is 200 ms; it is left out otherwise.
CLICK_AFTER_ENTER = """async (pause) => {
  const changed = new Promise((done) => new MutationObserver(() => done(performance.now())).observe(
    document.querySelector('.stage'), { attributes: true, attributeFilter: ['data-vertex'] }));
  window.dispatchEvent(new KeyboardEvent('keydown', { key: 'Enter' }));
  const since = await changed;
  await new Promise((done) => setTimeout(done, pause));
  if (performance.now() - since > 190) return false;
  const target = document.querySelector('[role=application]');
  const box = target.getBoundingClientRect();
  const at = { bubbles: true, button: 0, pointerId: 1, clientX: box.x + 300, clientY: box.y + 300 };
  target.setPointerCapture = () => undefined;
  target.dispatchEvent(new PointerEvent('pointerdown', at));
  target.dispatchEvent(new PointerEvent('pointerup', at));
  return true;
}"""


def change_person(page: Page, to: Page) -> Page:
    """Sign the browser of a page in as the person of another one, in one step, and return a page that shows it."""
    page.context.add_cookies([{**cookie} for cookie in to.context.cookies()])  # pyright: ignore[reportArgumentType] - what it gave
    return page.context.new_page()


def test_answers_are_never_sent_as_somebody_else(sign_in: SignIn, track: Track) -> None:
    pia, quin = marker(sign_in, track, "Pia"), sign_in("Quin", "annotator")
    vertex, placed = pia.vertex, pia.click(0.3, 0.4)
    context = pia.page.context
    context.route("**/answer", lambda route: route.abort())
    pia.page.keyboard.press("Enter")
    pia.page.get_by_test_id("unsent").wait_for()
    pias = context.cookies()
    other = change_person(pia.page, quin)
    other.goto(track.url)
    context.unroute("**/answer")
    # Pia's page sends now, if its own timer did not come first, with the cookie that has become Quin's.
    pia.page.evaluate("window.dispatchEvent(new Event('online'))")
    for page in (pia.page, other):
        expect(page.get_by_test_id("of-others")).to_contain_text("until Pia signs in again")
        expect(page.get_by_text("Quin", exact=True)).to_be_visible()
    assert Marker(other, track).own_marks() == {}
    context.add_cookies([{**cookie} for cookie in pias])  # pyright: ignore[reportArgumentType] - what it gave
    other.goto(track.url)
    wait_for_mark(Marker(other, track), vertex, placed)


def test_a_page_whose_browser_became_somebody_elses_is_theirs_from_then_on(sign_in: SignIn, track: Track) -> None:
    uma, vic = marker(sign_in, track, "Uma"), sign_in("Vic", "annotator")
    change_person(uma.page, vic).goto(track.url)
    uma.page.keyboard.press("s")
    expect(uma.page.get_by_text("Vic", exact=True)).to_be_visible()
    uma.ready()
    uma.save("r")
    assert [item["person"] for item in uma.own_marks().values()] == ["Vic"]


def test_what_the_service_does_not_take_is_shown_and_kept(sign_in: SignIn, track: Track) -> None:
    rosa = marker(sign_in, track, "Rosa")
    vertex, placed = rosa.vertex, rosa.click(0.3, 0.4)
    me = rosa.page.request.get(f"{track.url}/v1/me").json()["id"]
    track.owner.fleets.set_role(track.fleet_id, me, "viewer")
    rosa.page.keyboard.press("Enter")
    refused = rosa.page.get_by_test_id("refused")
    expect(refused).to_contain_text("This takes the role annotator")
    expect(refused).to_contain_text(f"{placed[0]:.1f}")
    rosa.page.reload()
    expect(refused).to_contain_text(f"{placed[0]:.1f}")
    assert vertex not in rosa.own_marks()
    refused.get_by_role("button", name="Give it up").click()
    expect(refused).to_have_count(0)
