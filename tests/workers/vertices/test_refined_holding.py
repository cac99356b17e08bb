"""How a recording's boards are held, from likelihoods of their rolls."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.detection.holds import run
from workers.vertices.board.holding import learn_roll
from workers.vertices.board.model import ROLLS, any_roll
from workers.vertices.board.refined import roll_prior

GENERAL = any_roll((0.6, 0.9))


def boxes(rolls, half, *, seed=3, width=1.0):
    """Any roll within an interval around each true one is as likely; the other way to hold the board is not."""
    random = np.random.default_rng(seed)
    told = np.full((len(rolls), 2, ROLLS.size), -math.inf)
    for row, roll in zip(told, rolls, strict=True):
        middle = roll + random.uniform(-half, half) * width
        row[0, np.abs(ROLLS - middle) <= half] = 0.0
    return told


@pytest.mark.parametrize("mean_deg", [-18.0, 0.0, 15.0])
def test_intervals_tell_the_mean_roll_without_a_pull_towards_the_usual(mean_deg):
    off = []
    for seed in range(8):
        rolls = np.radians(np.random.default_rng(seed + 40).normal(mean_deg, 3.0, 24))
        holding = learn_roll(boxes(rolls, math.radians(8.0), seed=seed), GENERAL)
        off.append((holding.roll[0] - rolls.mean()) / holding.mean_sigma)
        assert math.degrees(holding.roll[1]) == pytest.approx(3.0, abs=2.5)
        assert holding.swapped < 0.15
    assert abs(np.mean(off)) < 0.75
    assert np.sqrt(np.mean(np.square(off))) < 1.6


def test_some_false_boards_do_not_move_the_mean():
    rolls = np.radians(np.random.default_rng(1).normal(12.0, 2.5, 20))
    alone = learn_roll(boxes(rolls, math.radians(4.0)), GENERAL)
    false = boxes(np.full(4, math.radians(-20.0)), math.radians(1.0), seed=9)
    mixed = learn_roll(np.concatenate([boxes(rolls, math.radians(4.0)), false]), GENERAL)
    assert math.degrees(abs(mixed.roll[0] - alone.roll[0])) < 1.5


def test_sweeps_that_were_recorded_twice_tell_a_roll_nothing_new():
    def seen(time_ns):
        hold = SimpleNamespace(roll=0.1, roll_sigma=0.02)
        return SimpleNamespace(time_ns=time_ns, board=SimpleNamespace(xyz=np.zeros(3), hold=hold))

    model = SimpleNamespace(roll=(0.0, 0.2))
    assert roll_prior(seen(0), [seen(0)], model) == model.roll
    next_one, twice = (roll_prior(seen(0), [seen(100_000_000)] * count, model) for count in (1, 2))
    assert 0.0 < next_one[0] < 0.1
    assert twice == next_one


def test_no_mean_explains_two_ways_to_hold_a_board():
    alike, apart = (learn_roll(boxes(np.radians([18.0, sign * 18.0] * 6), 0.02), GENERAL).stray for sign in (1, -1))
    assert alike < 0.25 < 0.4 < apart


@pytest.mark.parametrize("hold", ["mirrored", "rolled", "leaning", "turned", "torso"])
def test_a_board_is_found_however_it_is_held(hold):
    """Drawn poses: mirrored, rolled to both sides by 18 degrees, leaning by 35, turned by 60, a torso behind."""
    poses, off = run(950001, hold)
    assert len(off) >= 0.85 * poses
    assert np.count_nonzero(np.array(off) > 0.1) == 0
    assert np.median(off) < 0.03
