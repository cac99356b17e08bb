"""Whatever computes for long ends within a second of being told to, and nobody who is not told sees a difference."""

import threading
import time
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from tests.workers.solver.rigs import simulated
from tests.workers.solver.test_clock_offset import estimate_offset, marked
from workers.geometry.models import MODELS
from workers.solver.baselines import linear_baseline, linear_starts
from workers.solver.narrowing import run_search
from workers.solver.outliers import judge
from workers.solver.polish import polish
from workers.solver.slot import run_slot, warm_up
from workers.solver.solution import finished

# Seconds of the processor: what other processes take meanwhile does not count.
SOON_S = 3.0


class ToldToEndError(Exception):
    pass


class Told:
    """A stop that says so after some seconds, and counts who asks."""

    def __init__(self, after_s=None, after_looks=None):
        self.flag = bytearray(1)
        self.looks = 0
        self.at = float("inf")
        self._after_looks = after_looks
        if after_s is not None:
            threading.Timer(after_s, self._set).start()

    def _set(self):
        self.at = time.process_time()
        self.flag[0] = 1

    def check(self):
        self.looks += 1
        if self.looks == self._after_looks:
            self._set()
        if self.flag[0]:
            raise ToldToEndError


def outcome(problem):
    return run_slot(problem, problem.lower.tolist(), problem.upper.tolist(), 0, 0)


@pytest.mark.parametrize("loss", ["mean", "saturating"])
@pytest.mark.parametrize("model", MODELS)
def test_who_may_stop_a_slot_changes_no_bit_of_it(model, loss):
    problem, _ = simulated(model, 3, loss=loss, schedule={"population": 300, "generations": 12})
    stop = Told()
    assert outcome(replace(problem, stop=stop)) == outcome(problem)
    assert stop.looks > 0


@pytest.mark.parametrize(
    ("model", "pairs", "population"),
    [*((model, 40, 100_000) for model in MODELS), ("brown_conrady", 8_000, 64)],
)
def test_a_running_slot_ends_at_once(model, pairs, population):
    # Minutes of work: of many evaluations, or of generations that each take long.
    schedule = {"population": population, "generations": 10_000}
    warm_up()
    problem, _ = simulated(model, 3, pairs=pairs, schedule=schedule)
    stop = Told(after_s=0.3)
    with pytest.raises(ToldToEndError):
        outcome(replace(problem, stop=stop))
    assert time.process_time() - stop.at < SOON_S


@pytest.mark.parametrize("work", [polish, judge, linear_baseline, finished])
def test_what_comes_after_the_search_looks_again_and_again(work):
    problem, truth = simulated("brown_conrady", 5, loss="saturating", schedule={"population": 100, "generations": 8})
    state = run_search(problem)
    more = {polish: (truth,), judge: (truth,), linear_baseline: (), finished: (state,)}[work]
    calm = Told()
    work(replace(problem, stop=calm), *more)
    assert calm.looks >= (1 if work is linear_baseline else 10)
    for looks in sorted({1, calm.looks // 2, calm.looks} - {0}):
        stop = Told(after_looks=looks)
        with pytest.raises(ToldToEndError):
            work(replace(problem, stop=stop), *more)
        assert stop.looks == looks, "nobody catches it on its way out"


def test_an_estimate_of_the_clocks_looks_again_and_again():
    asked = marked(6, 20_000_000, length_s=30.0)
    calm = Told()
    estimate_offset(*asked, stop=calm)
    assert calm.looks > 20
    with pytest.raises(ToldToEndError):
        estimate_offset(*asked, stop=Told(after_looks=calm.looks // 2))


def test_a_linear_start_from_very_many_pairs_takes_little_memory_and_looks_on_its_way():
    problem, _ = simulated("pinhole", 3, pairs=12_000)
    stop = Told()
    tracemalloc.start()
    starts = linear_starts(replace(problem, stop=stop))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(starts) > 0 and np.isfinite(starts).all()
    assert peak < 110e6, "a batch of samples at once takes 200 MB"
    assert stop.looks > 5
