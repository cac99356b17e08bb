"""`python -m benchmarks.farm`: what the farm costs beside the work itself. SHORT=1 for a short form.

A calibration in five folds through PostgreSQL, the broker and two worker processes, over its runs in two bare
processes, turn by turn, with the same bits; the trip of a job with almost nothing to do on both databases (wall
milliseconds of two pool processes, and processor milliseconds of all processes); one run of the toolbox's preset
farmed slot by slot; batches on 1, 2 and 4 worker processes. PostgreSQL and SQLite sync every commit. The last line is
JSON.
"""

from __future__ import annotations

import json
import os
import secrets
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

from benchmarks.farm.calibration import beside_bare
from benchmarks.farm.scaling import scaling
from benchmarks.farm.trips import trips
from benchmarks.house import House


def measure(*, short: bool, seed: int) -> dict[str, Any]:
    """All figures; see the module."""
    rounds = 3 if short else 9
    trip: dict[str, dict[str, float]] = {}
    with _house("postgresql") as (house, folder):
        figures = beside_bare(house, folder, rounds, seed)
        trip["postgresql"] = trips(house, rounds, seed)
        figures |= scaling(house, 1 if short else 3, 8 if short else 20, seed)
    with _house("sqlite") as (house, _):
        trip["sqlite"] = trips(house, rounds, seed)
    return figures | {
        "trip_ms": {database: found["ms"] for database, found in trip.items()},
        "trip_cpu_ms": {database: found["cpu_ms"] for database, found in trip.items()},
        "round_trips": {
            database: found["sql_statements"] + found["broker_commands"] for database, found in trip.items()
        },
        "sql_statements": {database: found["sql_statements"] for database, found in trip.items()},
        "broker_commands": {database: found["broker_commands"] for database, found in trip.items()},
        "seed": seed,
    }


@contextmanager
def _house(database: Literal["postgresql", "sqlite"]) -> Iterator[tuple[House, Path]]:
    with tempfile.TemporaryDirectory(prefix="apexcal-farm-") as folder:
        house = House(Path(folder) / "data", 2, database)
        try:
            yield house, Path(folder)
        finally:
            house.close()


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _rounded(one) for name, one in value.items()}
    return round(value, 3) if isinstance(value, float) else value


def main() -> None:
    short = os.environ.get("SHORT", "") not in ("", "0")
    print(json.dumps(_rounded(measure(short=short, seed=int(os.environ.get("SEED") or secrets.randbits(31))))))


if __name__ == "__main__":
    main()
