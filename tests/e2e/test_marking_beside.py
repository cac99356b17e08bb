"""What stands beside the marking: a question about a mark that is far from the others, and the LiDAR's sweep."""

import re
from collections.abc import Callable

import pytest
from playwright.sync_api import Page, expect

from tests.e2e.conftest import Track
from tests.e2e.looks import View, assert_looks, each_view
from tests.e2e.marking import Marker
from tests.e2e.test_marking import ask_marks

SignIn = Callable[[str, str], Page]
ASIDE_PX = 60


@pytest.fixture(autouse=True)
def everybody_gets_every_vertex(track: Track) -> None:
    ask_marks(track, 50)


def click_corner(marker: Marker, aside_px: float = 0) -> tuple[float, float]:
    """Click where the camera sees the board's corner, or so far beside it; the pixel that was clicked."""
    said = re.search(r"frame (\d+)", marker.view().get_attribute("aria-label") or "")
    assert said
    u, v = marker.track.truth["frames"]["apex_uv"][int(said[1])]
    width, height = marker.track.image_size
    u += aside_px if u < width / 2 else -aside_px
    frame, view = marker.frame().bounding_box(), marker.view().bounding_box()
    assert frame and view
    x = frame["x"] + (u + 0.5) * frame["width"] / width
    y = frame["y"] + (v + 0.5) * frame["height"] / height
    return marker.click((x - view["x"]) / view["width"], (y - view["y"]) / view["height"])


def test_a_mark_far_from_the_others_is_asked_about_and_kept_as_it_is(sign_in: SignIn, track: Track) -> None:
    june = Marker(sign_in("June", "annotator"), track)
    june.open()
    question = june.page.get_by_role("alert").filter(has_text="Is this the corner?")
    for _ in range(14):
        click_corner(june)
        june.save()  # no good mark is asked about

    # What was marked before the page was loaded counts.
    june.reload()
    june.page.wait_for_load_state("networkidle")
    vertex = june.vertex
    far = click_corner(june, ASIDE_PX)
    expect(question).to_have_count(0)
    june.page.keyboard.press("Enter")
    expect(question).to_be_visible()
    said = re.search(r"(\d+) px from here. Good marks are within (\d+) px", question.inner_text())
    assert said and abs(int(said[1]) - ASIDE_PX) < 15 and int(said[2]) < ASIDE_PX / 2
    assert vertex not in june.own_marks()
    assert june.shown() == 1  # the mark, and nothing of where it is expected
    expect(june.view().locator(".predicted")).to_have_count(0)
    # The key that saves every mark does not keep it, however often it is pressed.
    for _ in range(3):
        june.page.keyboard.press("Enter")
    assert june.vertex == vertex and vertex not in june.own_marks()
    june.save("k")
    mark = june.own_marks()[vertex]["mark"]
    assert (mark["u"], mark["v"]) == pytest.approx(far, abs=0.51)

    # Or it is set again.
    vertex = june.vertex
    click_corner(june, -ASIDE_PX)
    june.page.keyboard.press("Enter")
    expect(question).to_be_visible()
    june.page.keyboard.press("Escape")
    expect(question).to_have_count(0)
    assert june.shown() == 0
    good = click_corner(june)
    june.save()
    mark = june.own_marks()[vertex]["mark"]
    assert (mark["u"], mark["v"]) == pytest.approx(good, abs=0.51)


def test_the_sweep_stands_beside_the_frame(sign_in: SignIn, track: Track) -> None:
    kurt = Marker(sign_in("Kurt", "annotator"), track)
    kurt.open()
    pane = kurt.page.get_by_role("region", name="The sweep of this vertex")
    expect(pane).to_have_count(0)  # 1280 px are narrow
    kurt.page.keyboard.press("l")
    sweeps = {str(one.id): one.sweep_index for one in track.owner.detections.vertices(track.detection_id)}
    for _ in range(3):
        expect(pane).to_have_attribute("data-sweep", str(sweeps[kurt.vertex]))
        expect(pane.get_by_role("application")).to_have_attribute("data-sweeps", str(sweeps[kurt.vertex]))
        expect(pane.get_by_role("application")).to_have_attribute("data-pictures", re.compile("[1-9]"))
        # Nothing of it is drawn into the frame, and the keys stay with the marking.
        assert kurt.shown() == 0
        box = pane.get_by_role("application").bounding_box()
        assert box
        kurt.page.mouse.move(box["x"] + 50, box["y"] + 60)
        kurt.page.mouse.down()
        kurt.page.mouse.move(box["x"] + 90, box["y"] + 70, steps=3)
        kurt.page.mouse.up()
        vertex, given = kurt.vertex, kurt.click(0.4, 0.4)
        kurt.save()
        mark = kurt.own_marks()[vertex]["mark"]
        assert (mark["u"], mark["v"]) == pytest.approx(given, abs=0.51)
    # A person who wants it finds it again.
    kurt.reload()
    expect(pane).to_be_visible()
    kurt.page.get_by_role("button", name="LiDAR", exact=False).first.click()
    expect(pane).to_have_count(0)


@each_view
def test_the_marking_page_is_accessible_and_fits_a_phone(
    sign_in: SignIn, track: Track, views: tuple[View, ...]
) -> None:
    lore = Marker(sign_in(f"Lore {len(views)}", "annotator"), track)
    lore.open()
    lore.page.keyboard.press("l")
    assert_looks(lore.page, views)
