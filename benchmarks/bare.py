"""The same runs without any queue: processes that call the solver's own functions on documents in memory."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple
from uuid import UUID

# One thread of linear algebra, as in every worker; idle ones would keep spinning.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

from sqlalchemy import ColumnElement, select  # noqa: E402

from service.platform.db.calibrations import CalibrationRun, CorrespondenceSet, Result  # noqa: E402
from service.platform.db.session import Database  # noqa: E402
from workers.solver.narrowing import run_search  # noqa: E402
from workers.tasks.run_inputs import read_run  # noqa: E402
from workers.tasks.solving import solved  # noqa: E402
from workers.tasks.warming import warm_up  # noqa: E402

_PROCESSES = 2
# What a worker adds to what was found: how long it took, and what it was made of.
_ADDED = ("finish_seconds", "provenance")


class Run(NamedTuple):
    """A run of the service: its id, the document that the solver reads, the fold held out, its pairs by column."""

    id: str
    document: dict[str, Any]
    fold: int
    pairs: dict[str, Any]


def runs_of(database: Database, which: ColumnElement[bool]) -> list[Run]:
    """The runs of these calibrations, in the order in which the service began them."""
    with database.reading() as session:
        rows = session.execute(
            select(CalibrationRun.id, CalibrationRun.fit_request, CalibrationRun.fold, CorrespondenceSet)
            .join(CorrespondenceSet, CorrespondenceSet.id == CalibrationRun.set_id)
            .where(which)
            .order_by(CalibrationRun.id)
        ).all()
        return [Run(str(id), problem, fold, pairs.columns) for id, problem, fold, pairs in rows]


def assert_same_bits(database: Database, bare: Mapping[str, dict[str, Any]]) -> None:
    """What the service stored of each run is what the bare process found."""
    with database.reading() as session:
        asked = select(Result.run_id, Result.document).where(Result.run_id.in_([UUID(run_id) for run_id in bare]))
        found = {str(run_id): document for run_id, document in session.execute(asked)}
    for run_id, document in bare.items():
        stored = {name: value for name, value in found[run_id].items() if name not in _ADDED}
        other = sorted(name for name in {*stored, *document} if stored.get(name) != document.get(name))
        assert not other, f"run {run_id} came to other bits: {other}"


class Bare:
    """Two processes that take one run after the other. They compile before they begin."""

    def __init__(self, runs: Sequence[Run], folder: Path) -> None:
        context = get_context("spawn")
        self._count = len(runs)
        self._next, self._ended = context.Value("i", 0), context.Value("i", 0)
        self._begin, self._write = (context.Barrier(_PROCESSES + 1) for _ in range(2))
        self._outputs = [folder / f"bare-{number}.jsonl" for number in range(_PROCESSES)]
        source = folder / "runs.json"
        source.write_text(json.dumps(runs))
        shared = (self._next, self._ended, self._begin, self._write)
        self._children = [
            context.Process(target=_work, args=(source, output, *shared), daemon=True) for output in self._outputs
        ]
        for child in self._children:
            child.start()

    def begin(self) -> None:
        """Wait until every process has loaded the runs and compiled; then they begin."""
        self._begin.wait()

    @property
    def pids(self) -> list[int]:
        """The processes' ids."""
        return [child.pid or 0 for child in self._children]

    @property
    def is_done(self) -> bool:
        """Whether every run has ended. The processes live on until their results are read."""
        return self._ended.value >= self._count

    def results(self) -> dict[str, dict[str, Any]]:
        """Each run's document, by its id; the processes end."""
        self._write.wait()
        for child in self._children:
            child.join()
        return dict(json.loads(line) for output in self._outputs for line in output.read_text().splitlines())


def _work(source: Path, output: Path, following: Any, ended: Any, begin: Any, write: Any) -> None:
    runs = [Run(*one) for one in json.loads(source.read_text())]
    warm_up()
    documents: list[tuple[str, dict[str, Any]]] = []
    begin.wait()
    while (number := _take(following)) < len(runs):
        documents.append((runs[number].id, _solve(runs[number])))
        with ended.get_lock():
            ended.value += 1
    # Alive until then, so that the time that it took can be read.
    write.wait()
    output.write_text("".join(json.dumps(one) + "\n" for one in documents))


def _take(following: Any) -> int:
    with following.get_lock():
        number = int(following.value)
        following.value += 1
    return number


def _solve(run: Run) -> dict[str, Any]:
    """As a worker does a whole run."""
    fit = read_run(run.document, run.fold, run.pairs)
    state = run_search(fit.problem)
    return solved(fit, state).model_dump(mode="json", exclude_unset=True)
