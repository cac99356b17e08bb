"""The consensus of several people: its rules, and the geometric median as an optimum."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.annotations.consensus import ConsensusOutcome, Opinion, agree, far_apart_px, geometric_median

coordinate = st.floats(-0.5, 2000.0).map(lambda value: round(value, 3))
pixel = st.tuples(coordinate, coordinate)


def total(place, points):
    return math.fsum(math.hypot(u - place[0], v - place[1]) for u, v in points)


def confirmed(u, v):
    return Opinion("confirmed", (u, v))


def test_two_marks_give_their_mean_and_their_spread():
    found = agree([confirmed(10.0, 20.0), confirmed(14.0, 20.0)])
    assert found.pixel == (12.0, 20.0)
    assert found.spread_px == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("verdicts", "outcome"),
    [
        (["confirmed", "confirmed", "rejected"], ConsensusOutcome.KEPT),
        (["confirmed", "rejected"], ConsensusOutcome.TIED),
        (["confirmed", "rejected", "unsure"], ConsensusOutcome.TIED),
        (["confirmed", "rejected", "rejected"], ConsensusOutcome.REMOVED),
        (["rejected", "unsure", "unsure"], ConsensusOutcome.REMOVED),
        (["confirmed", "unsure", "unsure"], ConsensusOutcome.KEPT),
        (["unsure"], ConsensusOutcome.UNMARKED),
        ([], ConsensusOutcome.UNMARKED),
    ],
)
def test_verdicts_are_counted_and_unsure_counts_neither_way(verdicts, outcome):
    opinions = [Opinion(verdict, (1.0, 2.0)) for verdict in verdicts]
    found = agree(opinions)
    assert found.outcome is outcome
    assert found.answers == len(verdicts)
    assert (found.pixel is not None) == (outcome in (ConsensusOutcome.KEPT, ConsensusOutcome.TIED))


def test_marks_of_people_who_did_not_confirm_are_not_used():
    found = agree([confirmed(10.0, 10.0), Opinion("unsure", (90.0, 90.0)), Opinion("rejected", (50.0, 50.0))])
    assert (found.pixel, found.marks) == ((10.0, 10.0), 1)


def test_a_confirmation_without_a_mark_gives_nothing_but_still_outvotes():
    assert agree([Opinion("confirmed")]).outcome is ConsensusOutcome.UNMARKED
    found = agree([confirmed(1.0, 1.0), Opinion("confirmed"), Opinion("rejected")])
    assert (found.outcome, found.marks) == (ConsensusOutcome.KEPT, 1)


def test_two_marks_that_cannot_both_be_right_give_no_mean():
    apart = far_apart_px(1920, 1200)
    assert apart == pytest.approx(22.64, abs=0.01)
    found = agree([confirmed(100.0, 100.0), confirmed(127.0, 136.0)], apart)
    assert (found.outcome, found.pixel, found.answers) == (ConsensusOutcome.APART, None, 2)
    near = agree([confirmed(100.0, 100.0), confirmed(104.0, 103.0)], apart)
    assert near.pixel == (102.0, 101.5)
    third = agree([confirmed(100.0, 100.0), confirmed(127.0, 136.0), confirmed(101.0, 100.0)], apart)
    assert third.pixel == pytest.approx((101.0, 100.0), abs=1.0)


@settings(max_examples=300, deadline=None)
@given(st.lists(pixel, min_size=3, max_size=9))
def test_the_median_is_an_optimum(points):
    found = geometric_median(points)
    best = total(found, points)
    slack = 1e-9 * (1.0 + best)
    for step in (100.0, 1.0, 1e-3):
        for k in range(8):
            angle = k * math.pi / 4
            beside = (found[0] + step * math.cos(angle), found[1] + step * math.sin(angle))
            assert best <= total(beside, points) + slack
    assert all(best <= total(point, points) + slack for point in points)


@settings(max_examples=200, deadline=None)
@given(st.lists(pixel, min_size=1, max_size=7), st.randoms(use_true_random=False))
def test_the_order_of_people_changes_no_bit(points, random):
    shuffled = list(points)
    random.shuffle(shuffled)
    assert agree([confirmed(*p) for p in points]) == agree([confirmed(*p) for p in shuffled])


def test_a_reviewed_answer_counts_but_is_not_independent():
    seen = Opinion("confirmed", (14.0, 20.0), reviewed=True)
    found = agree([confirmed(10.0, 20.0), seen])
    assert found.pixel == (12.0, 20.0)
    assert (found.marks, found.reviewed, found.spread_px) == (1, 1, 0.0)
    alone = agree([seen])
    assert (alone.outcome, alone.pixel, alone.marks, alone.spread_px) == (ConsensusOutcome.KEPT, (14.0, 20.0), 0, 0.0)
    assert agree([confirmed(1.0, 1.0), Opinion("rejected", reviewed=True)]).outcome is ConsensusOutcome.TIED
