"""Work that no worker answers for says so where it waits, and no longer than that, in a browser."""

import json
import os
import signal
import sqlite3
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import expect

from tests.e2e.conftest import SignIn, Track
from tests.e2e.looks import View, assert_looks, each_view
from tests.support.served import Embedded

NOTE = "No worker answers: this waits."
# Nine seconds on an idle machine: workers are silent for 8 s, and a page asks every second.
SAID_MS = 30_000


@contextmanager
def stopped(served: Embedded) -> Iterator[None]:
    """A frozen worker, which goes on afterwards. It does not hold the database's lock, which nobody could take."""
    worker = supervised(served)["worker"]
    os.kill(worker, signal.SIGSTOP)
    while not is_free(served.data / "apexcal.db"):
        os.kill(worker, signal.SIGCONT)
        time.sleep(0.1)
        os.kill(worker, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(worker, signal.SIGCONT)


def is_free(database: Path) -> bool:
    """Whether somebody may write to it within a second."""
    with closing(sqlite3.connect(database, timeout=1.0)) as connection:
        try:
            connection.execute("BEGIN IMMEDIATE")
        except sqlite3.OperationalError:
            return False
    return True


@contextmanager
def killed(served: Embedded) -> Iterator[None]:
    """A worker that died, which its frozen supervisor starts again afterwards."""
    children = supervised(served)
    os.kill(children["supervisor"], signal.SIGSTOP)
    try:
        os.kill(children["worker"], signal.SIGKILL)
        yield
    finally:
        os.kill(children["supervisor"], signal.SIGCONT)


def supervised(served: Embedded) -> dict[str, int]:
    """Process ids of `apexcal serve` and its children."""
    status = json.loads((served.data / "supervisor.json").read_text())
    return {"supervisor": status["pid"]} | {child["name"]: child["pid"] for child in status["children"]}


@each_view
@pytest.mark.parametrize("away", [stopped, pytest.param(killed, marks=pytest.mark.slow)])
def test_work_says_that_no_worker_answers_until_one_does(
    sign_in: SignIn,
    track: Track,
    served: Embedded,
    away: Callable[[dict[str, Any]], Any],
    views: tuple[View, ...],
) -> None:
    page = sign_in(f"Ugo {away.__name__} {len(views)}", "engineer")
    page.goto(f"{track.url}/recordings/{track.recording_id}?step=region")
    preview = page.get_by_role("button", name="Preview the region")
    expect(preview).to_be_enabled()
    note = page.get_by_role("status").filter(has_text=NOTE)
    with away(served):
        began = time.monotonic()
        preview.click()
        expect(page.get_by_role("progressbar", name="counting points")).to_be_visible()
        expect(note).to_have_count(0)
        expect(note).to_be_visible(timeout=SAID_MS)
        print(f"{away.__name__}: said after {time.monotonic() - began:.1f} s")
        assert_looks(page, views)
    expect(note).to_have_count(0)
    expect(page.get_by_text("Keeps")).to_contain_text("sweeps")
