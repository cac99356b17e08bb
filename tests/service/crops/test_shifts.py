"""Which marks of a page are shifted, and how far."""

import math
from collections import Counter
from random import Random
from uuid import UUID

import pytest

from apexcal.documents.crops import LEAST_SHIFTED, LEAST_SIDE_PX, MOST_SIDE_PX, SHIFT_SHARES, side_of
from service.crops.shifts import MISSED_SHARE, ShownMark, draw_page


def marks(count, first=0, u=300.0, v=200.0, side_px=64.0):
    room = ((0.0, 639.0), (0.0, 479.0))
    return [ShownMark(UUID(int=first + index), u, v, side_px, room) for index in range(count)]


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
                assert 64 * SHIFT_SHARES[0] <= drawn_off(crop) <= 64 * SHIFT_SHARES[1]
                directions.append(math.atan2(crop.v - crop.mark.v, crop.u - crop.mark.u))
            else:
                assert (crop.u, crop.v) == (crop.mark.u, crop.mark.v)
        counts[sum(crop.shifted for crop in page)] += 1
    assert set(counts) == {3, 4, 5, 6} and min(counts.values()) > 30, "their number tells nothing either"
    resultant = math.hypot(sum(map(math.cos, directions)), sum(map(math.sin, directions))) / len(directions)
    assert resultant < 3.5 / math.sqrt(2 * len(directions)), "one direction is as likely as another (Rayleigh)"


def test_each_place_of_a_page_is_shifted_alike_often():
    places = Counter(
        place
        for seed in range(2000)
        for place, crop in enumerate(draw_page(marks(30), [], Random(seed)))
        if crop.shifted
    )
    expected = sum(places.values()) / 24
    assert all(abs(places[place] - expected) < 4.5 * math.sqrt(expected) for place in range(24))


def test_the_last_page_shifts_marks_that_were_confirmed_before_so_that_it_is_the_last():
    page = draw_page(marks(2), marks(40, first=100), Random(1))
    assert len(page) == 24
    assert not any(crop.shifted for crop in page if crop.mark.vertex_id.int < 100)
    assert sum(crop.shifted for crop in page) >= LEAST_SHIFTED


@pytest.mark.parametrize(("u", "v"), [(0.0, 0.0), (639.0, 479.0), (0.0, 250.0)])
def test_a_shifted_mark_stays_where_its_picture_is(u, v):
    for seed in range(50):
        for crop in draw_page(marks(8, u=u, v=v), [], Random(seed)):
            assert 0.0 <= crop.u <= 639.0 and 0.0 <= crop.v <= 479.0


def test_the_crop_follows_the_boards_edge_between_two_bounds():
    assert [side_of(edge) for edge in (None, 10.0, 70.0, 500.0)] == [LEAST_SIDE_PX, LEAST_SIDE_PX, 70.0, MOST_SIDE_PX]
    assert LEAST_SIDE_PX * SHIFT_SHARES[0] > 5.0, "a shifted mark is one that the bench counts as wrong"


def test_the_root_mean_square_of_a_shift_is_that_of_the_drawn_ones():
    squares = [
        ((crop.u - crop.mark.u) ** 2 + (crop.v - crop.mark.v) ** 2) / 2
        for seed in range(2000)
        for crop in draw_page(marks(30, side_px=1.0), [], Random(seed))
        if crop.shifted
    ]
    assert math.sqrt(sum(squares) / len(squares)) == pytest.approx(MISSED_SHARE, rel=0.02)
