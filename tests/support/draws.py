"""What tests draw: the same at every run, whichever process runs a test, and whatever ran before it.

Ids, secrets and `SystemRandom` all come from `os.urandom`. In the tests' process it answers from streams that follow
from `--draws N` and the test's id, a stream for each place that draws: how often a page is polled changes no row's
id. Fixtures that several tests share and modules that are imported have streams of their own. A forked child has the
system's draws again, as every other child has: no two processes draw the same, and what tests assert of a child's
draws holds for each of them.

What concurrent threads draw in one place, they draw in the order in which they come.
"""

from __future__ import annotations

import os
import random
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from random import Random
from types import FrameType

import pytest

from service.platform.db import base

_system = os.urandom
# Through them others draw.
_BETWEEN = ("random", "secrets", "uuid")
_PARAMETER = "drawn"
# 1 March 2026, when ids of an empty database begin.
_FIRST_NS = 1_772_323_200_000_000_000
_STEP_NS = 1_000_000


class Streams:
    """Random bytes that follow from a text: a stream for each place in the source."""

    def __init__(self, seed: str) -> None:
        self._seed = seed
        self._lock = threading.Lock()
        self._streams: dict[str, Random] = {}

    def draw(self, place: str, size: int) -> bytes:
        """Return the next bytes of a place."""
        with self._lock:
            stream = self._streams.get(place)
            if stream is None:
                stream = self._streams[place] = Random(f"{self._seed} {place}")
            return stream.randbytes(size)


class Draws:
    """The running test's streams in the place of `os.urandom`."""

    def __init__(self) -> None:
        self.seed = 0
        self._running: Streams | None = None
        self._shared: dict[str, Streams] = {}
        os.register_at_fork(after_in_child=self._end)

    def install(self, seed: int) -> None:
        """Answer from streams wherever a test runs, until this process ends."""
        self.seed = seed
        os.urandom = random._urandom = self._urandom  # type: ignore[attr-defined]

    @contextmanager
    def of_test(self, name: str, seed: int) -> Iterator[None]:
        """Draw from fresh streams."""
        random.seed(f"{seed} {name}")
        with self._drawing(Streams(f"{seed} {name}")):
            yield

    @contextmanager
    def of_shared(self, name: str) -> Iterator[None]:
        """Draw from streams that go on where this process left them: what is made twice has other ids."""
        with self._drawing(self._shared.setdefault(name, Streams(f"{self.seed} {name}"))):
            yield

    @contextmanager
    def _drawing(self, streams: Streams) -> Iterator[None]:
        before, self._running = self._running, streams
        try:
            yield
        finally:
            self._running = before

    def _end(self) -> None:
        self._running = None
        os.urandom = random._urandom = _system  # type: ignore[attr-defined]
        random.seed()

    def _urandom(self, size: int, /) -> bytes:
        running = self._running
        return _system(size) if running is None else running.draw(_place(sys._getframe(1)), size)


def _place(frame: FrameType | None) -> str:
    """Who draws: the innermost function that is no library of draws."""
    while frame is not None and frame.f_globals.get("__name__") in _BETWEEN:
        frame = frame.f_back
    return f"{frame.f_globals.get('__name__')}.{frame.f_code.co_qualname}" if frame else ""


class IdClock:
    """In the place of the module `time` where ids are made: a millisecond goes by from id to id."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._now_ns = _FIRST_NS

    def time_ns(self) -> int:
        with self._lock:
            self._now_ns += _STEP_NS
            return self._now_ns


DRAWS = Draws()


def _seeds(config: pytest.Config) -> range:
    first, _, last = config.getoption("draws").partition("-")
    return range(int(first), int(last or first) + 1)


def pytest_addoption(parser: pytest.Parser) -> None:
    """The one switch of all this."""
    text = "number that ids, secrets and SystemRandom of each test follow from; 0-299 runs each test 300 times"
    parser.addoption("--draws", default="0", metavar="N", help=text)


def pytest_configure(config: pytest.Config) -> None:
    DRAWS.install(_seeds(config)[0])


def pytest_report_header(config: pytest.Config) -> str:
    return f"draws: {_again(config.getoption('draws'))}"


def _again(seeds: int | str) -> str:
    return f"PYTHONHASHSEED={os.environ.get('PYTHONHASHSEED', 'random')} pytest --draws {seeds}"


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    seeds = _seeds(metafunc.config)
    if len(seeds) > 1:
        metafunc.fixturenames.append(_PARAMETER)
        metafunc.parametrize(_PARAMETER, seeds, indirect=True, ids=[f"{_PARAMETER}{seed}" for seed in seeds])


@pytest.fixture
def drawn(request: pytest.FixtureRequest) -> int:
    """The number that a test's draws follow from, where it runs with several."""
    return request.param


@pytest.fixture
def numbered_ids(monkeypatch: pytest.MonkeyPatch) -> None:
    """Number the ids that this process makes instead of dating them: for a database that begins empty."""
    monkeypatch.setattr(base, "time", IdClock())


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector: pytest.Collector) -> Iterator[None]:
    with DRAWS.of_shared(collector.nodeid):
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    seed = _seed(item)
    name = item.nodeid.replace(f"[{_PARAMETER}{seed}]", "").replace(f"{_PARAMETER}{seed}-", "")
    with DRAWS.of_test(name.replace(f"-{_PARAMETER}{seed}]", "]"), seed):
        return (yield)


def _seed(item: pytest.Item) -> int:
    return item.callspec.params.get(_PARAMETER, DRAWS.seed) if hasattr(item, "callspec") else DRAWS.seed


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(fixturedef: pytest.FixtureDef, request: pytest.FixtureRequest) -> Iterator[None]:
    if fixturedef.scope == "function":
        return (yield)
    with DRAWS.of_shared(f"{request.node.nodeid} {fixturedef.argname} {request.param_index}"):
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Iterator[pytest.TestReport]:
    report = yield
    if report.failed:
        report.sections.append(("draws", _again(_seed(item))))
    return report
