"""Which marks of a page are shifted, how far, and that nothing but a look tells which."""

import math
from collections import Counter
from random import Random
from uuid import UUID

import pytest

from apexcal.documents.crops import (
    LEAST_SHIFT_PX,
    LEAST_SHIFTED,
    LEAST_SIDE_PX,
    MOST_SHIFT_SHARE,
    MOST_SIDE_PX,
    expected_pixel,
    side_of,
)
from service.crops.pictures import Tile, limits_in
from service.crops.shifts import MOST_MISSED, ShownMark, draw_page, shift_px
from service.crops.trust import ShiftCount
from workers.tasks.crop_tiles import _span

WIDTH, HEIGHT = 640, 480


def marks(count, first=0, u=300.0, v=200.0, side_px=64.0):
    """Marks whose tiles are cut as the worker cuts them."""
    made = []
    for index in range(first, first + count):
        row = {"vertex_id": str(UUID(int=index)), "u": u, "v": v, "sigma_u": 0.3, "sigma_v": 0.3, "edge_px": side_px}
        expected = expected_pixel(row)
        (left, right), (top, bottom) = (
            _span(at, side_px, size) for at, size in zip(expected, (WIDTH, HEIGHT), strict=True)
        )
        limits_px = limits_in(Tile(left, top, right - left, bottom - top, 0, 0), side_px, WIDTH, HEIGHT)
        made.append(ShownMark(UUID(int=index), u, v, side_px, *expected, limits_px))
    return made


def drawn_off(crop):
    return math.hypot(crop.u - crop.mark.u, crop.v - crop.mark.v)


def test_a_page_shifts_at_least_three_marks_by_a_visible_amount_and_draws_the_others_where_they_are():
    counts: Counter[int] = Counter()
    directions = []
    for seed in range(200):
        page = draw_page(marks(100), [], Random(seed))
        assert len({crop.mark.vertex_id for crop in page}) == len(page) == 24
        for crop in page:
            if crop.shifted:
                assert drawn_off(crop) + 1e-9 >= LEAST_SHIFT_PX and drawn_off(crop) <= 64 * MOST_SHIFT_SHARE + 1e-9
                directions.append(math.atan2(crop.v - crop.mark.v, crop.u - crop.mark.u))
            else:
                assert (crop.u, crop.v) == (crop.mark.u, crop.mark.v)
        counts[sum(crop.shifted for crop in page)] += 1
    assert set(counts) == {3, 4, 5, 6} and min(counts.values()) > 30, "their number tells nothing either"
    # A hundred marks have a direction each of where they are expected: as many are independent.
    resultant = math.hypot(sum(map(math.cos, directions)), sum(map(math.sin, directions))) / len(directions)
    assert resultant < 3.5 / math.sqrt(2 * 100), "one direction is as likely as another (Rayleigh)"


def test_each_place_of_a_page_and_each_mark_is_shifted_alike_often():
    pages = [draw_page(marks(10), marks(40, first=100), Random(seed)) for seed in range(2000)]
    places = Counter(place for page in pages for place, crop in enumerate(page) if crop.shifted)
    expected = sum(places.values()) / 24
    assert all(abs(places[place] - expected) < 4.5 * math.sqrt(expected) for place in range(24))
    unjudged = sum(crop.shifted for page in pages for crop in page if crop.mark.vertex_id.int < 100)
    share = sum(places.values()) / (24 * 2000)
    assert abs(unjudged / 20_000 - share) < 4.5 * math.sqrt(share * (1 - share) / 20_000), "confirmed before or not"
    assert min(sum(crop.shifted for crop in page) for page in pages) == LEAST_SHIFTED


@pytest.mark.parametrize("side_px", [LEAST_SIDE_PX, 64.0, MOST_SIDE_PX])
def test_where_a_crop_is_drawn_tells_nothing_of_whether_it_is_shifted(side_px):
    """Of 2,000 crops of each kind, by every measure that the page's numbers give: the area below the ROC curve."""
    crops = {True: [], False: []}
    for seed in range(600):
        for crop in draw_page(marks(30, first=100 * seed, side_px=side_px), [], Random(seed)):
            crops[crop.shifted].append(crop)
    for name, measure in {
        "off the expected pixel": lambda c: math.hypot(c.u - c.mark.expected_u, c.v - c.mark.expected_v),
        "direction": lambda c: math.atan2(c.v - c.mark.expected_v, c.u - c.mark.expected_u),
        "in the tile, u": lambda c: abs(c.u - sum(c.mark.limits_px[0]) / 2),
        "in the tile, v": lambda c: abs(c.v - sum(c.mark.limits_px[1]) / 2),
    }.items():
        shifted, true = ([measure(crop) for crop in crops[kind][:2000]] for kind in (True, False))
        ranked = sorted([(value, 1) for value in shifted] + [(value, 0) for value in true])
        ranks = sum(rank for rank, (_, kind) in enumerate(ranked, 1) if kind)
        area = (ranks - len(shifted) * (len(shifted) + 1) / 2) / (len(shifted) * len(true))
        # Of 2,000 and 2,000 the area's deviation is 0.0091 (Mann and Whitney).
        assert abs(area - 0.5) < 0.03, f"{name}: {area:.3f}"


def test_an_honest_person_passes_and_a_careless_one_does_not():
    """One sees a mark to a pixel and flags beyond half of the least shift; the other flags what is off by 10 px."""
    failed = {2.5: 0, 10.0: 0}
    for seed in range(2000):
        page = draw_page(marks(30, side_px=LEAST_SIDE_PX), [], random := Random(seed))
        for limit in failed:
            seen = [math.hypot(*(random.gauss(a, 1.0) for a in (crop.u - 300.0, crop.v - 200.0))) for crop in page]
            missed = sum(crop.shifted and off < limit for crop, off in zip(page, seen, strict=True))
            failed[limit] += missed >= MOST_MISSED
    assert failed[2.5] <= 0.01 * 2000
    assert failed[10.0] >= 0.8 * 2000
    assert ShiftCount(4, 2).miss_rate > 0.4


@pytest.mark.parametrize(("u", "v"), [(0.0, 0.0), (639.0, 479.0), (0.0, 250.0)])
def test_a_shifted_mark_stays_where_its_picture_is(u, v):
    for seed in range(50):
        page = draw_page(marks(8, first=10 * seed, u=u, v=v), [], Random(seed))
        assert any(crop.shifted for crop in page)
        for crop in page:
            assert 0.0 <= crop.u <= 639.0 and 0.0 <= crop.v <= 479.0


def test_the_crop_follows_the_boards_edge_between_two_bounds():
    assert [side_of(edge) for edge in (None, 10.0, 70.0, 500.0)] == [LEAST_SIDE_PX, LEAST_SIDE_PX, 70.0, MOST_SIDE_PX]


def test_the_root_mean_square_of_a_shift_is_that_of_the_drawn_ones():
    squares = [
        ((crop.u - crop.mark.u) ** 2 + (crop.v - crop.mark.v) ** 2) / 2
        for seed in range(2000)
        for crop in draw_page(marks(30, side_px=80.0), [], Random(seed))
        if crop.shifted
    ]
    assert math.sqrt(sum(squares) / len(squares)) == pytest.approx(shift_px(80.0), rel=0.02)
