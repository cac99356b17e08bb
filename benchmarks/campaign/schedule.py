"""When what strikes: drawn from a seed before anything starts, so that a run can be asked for again."""

from __future__ import annotations

import heapq
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import count
from random import Random
from typing import NamedTuple

from benchmarks.campaign.kinds import KINDS, Undo
from benchmarks.campaign.plant import Plant

# A fault that finds nothing to hit, because it is just starting again or has no work, looks again for a while.
_WAITS_S = 20.0
_LOOKS_AGAIN_S = 0.25


class Planned(NamedTuple):
    """A fault that is due ``at_s`` seconds after the work began, for ``lasts_s`` seconds."""

    at_s: float
    kind: str
    lasts_s: float


def draw(random: Random, seconds: float, every_s: float, kinds: Sequence[str]) -> list[Planned]:
    """A schedule of about one fault per ``every_s`` seconds."""
    planned: list[Planned] = []
    at_s = random.uniform(0.5, 1.0) * every_s
    for kind in _endless(random, kinds):
        if at_s > seconds:
            return planned
        planned.append(Planned(round(at_s, 2), kind, round(random.uniform(*KINDS[kind].lasts_s), 2)))
        at_s += random.uniform(0.2, 1.8) * every_s
    raise AssertionError("the kinds never end")


def _endless(random: Random, kinds: Sequence[str]) -> Iterator[str]:
    """Kinds in random order, each as often as its weight says before any comes more often."""
    while True:
        deck = [kind for kind in kinds for _ in range(KINDS[kind].weight)]
        random.shuffle(deck)
        yield from deck


class Injector:
    """Carries a schedule out."""

    def __init__(self, plant: Plant, planned: Sequence[Planned], random: Random) -> None:
        self._plant = plant
        self._random = random
        self._began = time.monotonic()
        self._numbers = count(len(planned))
        self._due: list[tuple[float, int, Planned | Undo]] = [
            (fault.at_s, number, fault) for number, fault in enumerate(planned)
        ]
        heapq.heapify(self._due)
        self.injected: Counter[str] = Counter()

    @property
    def finished(self) -> bool:
        """Whether everything struck, and has ended."""
        return not self._due

    def step(self) -> None:
        """Do what is due, and start again what is dead."""
        self._plant.watch()
        now_s = time.monotonic() - self._began
        while self._due and self._due[0][0] <= now_s:
            _, _, what = heapq.heappop(self._due)
            if isinstance(what, Planned):
                self._strike(what, now_s)
            else:
                what()

    def _strike(self, fault: Planned, now_s: float) -> None:
        struck = KINDS[fault.kind].strike(self._plant, self._random)
        if not struck.target and now_s < fault.at_s + _WAITS_S:
            heapq.heappush(self._due, (now_s + _LOOKS_AGAIN_S, next(self._numbers), fault))
            return
        say(f"{now_s:7.1f} s  {fault.kind}  {struck.target or 'nothing there to hit'}  {fault.lasts_s or ''}")
        if struck.target:
            self.injected[fault.kind] += 1
        if struck.undo:
            heapq.heappush(self._due, (now_s + fault.lasts_s, next(self._numbers), struck.undo))


def say(line: str) -> None:
    """A line for whoever watches, beside the line of JSON."""
    print(line.rstrip(), file=sys.stderr, flush=True)
