"""What runs all the time reads what it answers, and not the history: with a million runs as with some thousands."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from service.platform.db.migrate import upgrade
from service.platform.db.session import Database
from service.platform.settings import Settings
from service.platform.storage.store import open_store
from tests.service.platform.db import asked
from tests.service.platform.db.history import Size, fill
from tests.service.platform.db.touched import touched
from tests.support.postgres import Postgres

SHORT = Size(runs=40_000, vehicles=200, answered=3_000)
LONG = Size(runs=1_000_000, vehicles=1_000, answered=100_000)


# The long form's history takes minutes to write.


class Most(NamedTuple):
    """What a function may touch: rows and pages (PostgreSQL), steps of the machine (SQLite)."""

    rows: int
    pages: int
    steps: int


# A page of a list has 100 items, some of them with rows of their own. Small tables are rather read whole.
PERIODIC = Most(rows=500, pages=200, steps=3_000)
REQUEST = Most(rows=2_500, pages=1_500, steps=30_000)
# Two cameras for each vehicle, of each its newest sets and its publication, each by an index of a few pages' depth.
A_VEHICLE = Most(rows=40, pages=120, steps=700)
# Two cameras for each vehicle: of each its rig, publication, result and what ended since; then sorted and counted.
# PostgreSQL rather reads a table whole that has not many rows for each vehicle.
A_VEHICLES_HEALTH = Most(rows=400, pages=150, steps=2_000)
MARKING = Most(rows=1_000, pages=1_500, steps=10_000)


@pytest.fixture(scope="module", params=["sqlite", "postgresql"])
def kind(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(
    scope="module", params=[pytest.param(SHORT, id="short"), pytest.param(LONG, id="long", marks=pytest.mark.slow)]
)
def filled(
    request: pytest.FixtureRequest, kind: str, postgres: Postgres, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[Database, Size]]:
    """A database with its history."""
    size: Size = request.param
    folder = tmp_path_factory.mktemp("history")
    url = f"sqlite:///{folder / 'apexcal.db'}" if kind == "sqlite" else postgres.create(f"history_{size.runs}")
    upgrade(url)
    database = Database(url)
    fill(database, size)
    yield database, size
    database.close()


def test_what_nobody_asks_for_touches_a_handful(filled: tuple[Database, Size], tmp_path: Path):
    database, _ = filled
    store = open_store(Settings(data_dir=tmp_path))
    store.prepare()
    for function in asked.periodic(database, store).values():
        function()  # what is due is done
    over = {name: _over(database, function, PERIODIC) for name, function in asked.periodic(database, store).items()}
    assert not any(over.values()), over


def test_a_request_touches_no_more_than_its_page(filled: tuple[Database, Size]):
    database, _ = filled
    over = {name: _over(database, function, REQUEST) for name, function in asked.requests(database).items()}
    assert not any(over.values()), over


def test_a_fleet_request_looks_at_each_vehicle_and_not_at_its_history(filled: tuple[Database, Size]):
    database, size = filled
    most = Most(*(one * size.vehicles for one in A_VEHICLE))
    over = {name: _over(database, function, most) for name, function in asked.fleet_requests(database).items()}
    assert not any(over.values()), over


def test_the_health_of_a_fleet_looks_at_each_vehicle_and_not_at_its_history(filled: tuple[Database, Size]):
    database, size = filled
    most = Most(*(one * size.vehicles for one in A_VEHICLES_HEALTH))
    over = {name: _over(database, function, most) for name, function in asked.health(database).items()}
    assert not any(over.values()), over


def test_the_next_task_is_not_sought_past_all_answered_ones(filled: tuple[Database, Size]):
    database, _ = filled
    for function in asked.marking(database).values():
        function()  # everybody's first look is at all vertices
    over = {name: _over(database, function, MARKING) for name, function in asked.marking(database).items()}
    assert not any(over.values()), over


def _over(database: Database, function: asked.Asked, most: Most) -> str:
    """What a function touches too much, and its statements; empty where it keeps within its bounds."""
    with touched(database) as found:
        function()
    assert found.statements
    too_much = [
        f"{was} {name}, at most {limit}"
        for name, was, limit in zip(most._fields, (found.rows, found.pages, found.steps), most, strict=True)
        if was > limit
    ]
    return "; ".join(too_much + found.scans) if too_much else ""
