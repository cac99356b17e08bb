"""What a confirmation is worth."""

import random

import pytest

from service.crops.shifts import shift_px
from service.crops.trust import ShiftCount, widened_px, wrong_rate


def test_whoever_misses_shifted_marks_widens_what_they_confirm():
    careful, careless = ShiftCount(30, 0).miss_rate, ShiftCount(30, 10).miss_rate
    deviations = [widened_px(0.5, 48.0, 0.05, rates) for rates in ([careful], [careless], [1.0])]
    assert 0.5 < deviations[0] < deviations[1] < deviations[2]
    assert widened_px(0.5, 48.0, 0.05, [careless, careless]) < deviations[1], "two people see more than one"
    assert widened_px(0.5, 48.0, 0.05, []) == pytest.approx(widened_px(0.5, 48.0, 0.05, [1.0]))


def test_the_deviation_is_that_of_marks_of_which_some_are_wrong_and_were_accepted():
    p, m, sigma, side = 0.1, 0.3, 0.5, 48.0
    draw = random.Random(7)
    squares = []
    for _ in range(200_000):
        is_wrong = draw.random() < p
        if is_wrong and draw.random() >= m:
            continue  # seen and rejected
        squares.append((draw.gauss(0.0, sigma) + (draw.gauss(0.0, shift_px(side)) if is_wrong else 0.0)) ** 2)
    root = (sum(squares) / len(squares)) ** 0.5
    assert widened_px(sigma, side, p, [m]) == pytest.approx(root, rel=0.02)


def test_the_share_of_wrong_marks_allows_for_those_that_people_accepted():
    # 1000 marks, 100 of them wrong; people miss a third of the wrong ones.
    assert wrong_rate(67, 1000, [ShiftCount(300, 100)]) == pytest.approx(0.1, abs=0.002)
    assert wrong_rate(0, 0, []) == 0.5, "nobody has looked"
