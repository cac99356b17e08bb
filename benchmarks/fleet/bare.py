"""The same runs without any queue: processes that call the solver's own functions on documents in memory."""

from __future__ import annotations

import json
from collections.abc import Sequence
from multiprocessing import get_context
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, NamedTuple

from service.db.calibrations import CalibrationRun
from workers.solver.schedule import run_schedule
from workers.solver.solution import solve_finish
from workers.tasks.solving import fit_problem
from workers.tasks.warming import warm_up


class Run(NamedTuple):
    """A run of the service: its id, the document that the solver reads, and its pairs by column."""

    id: str
    document: dict[str, Any]
    pairs: dict[str, Any]


class Bare:
    """Two processes, or as many as asked for, that take one run after the other. They compile before they begin."""

    def __init__(self, runs: Sequence[Run], folder: Path, processes: int = 2) -> None:
        context = get_context("spawn")
        self._count = len(runs)
        self._next, self._ended = context.Value("i", 0), context.Value("i", 0)
        self._ready, self._leave = context.Barrier(processes + 1), context.Barrier(processes + 1)
        self._outputs = [folder / f"bare-{number}.jsonl" for number in range(processes)]
        source = folder / "runs.json"
        source.write_text(json.dumps(runs))
        self.children: list[BaseProcess] = [
            context.Process(
                target=_work,
                args=(source, output, self._next, self._ended, self._ready, self._leave),
                daemon=True,
            )
            for output in self._outputs
        ]
        for child in self.children:
            child.start()

    def wait_until_ready(self) -> None:
        """Until every process has loaded the runs and compiled; they begin at once."""
        self._ready.wait()

    @property
    def pids(self) -> list[int]:
        """The processes' ids."""
        return [child.pid or 0 for child in self.children]

    @property
    def is_done(self) -> bool:
        """Whether every run has ended."""
        return self._ended.value >= self._count

    def results(self) -> dict[str, dict[str, Any]]:
        """Each run's document, by its id; the processes end."""
        self._leave.wait()
        for child in self.children:
            child.join()
        lines = (line for output in self._outputs for line in output.read_text().splitlines())
        return dict(json.loads(line) for line in lines)


def _work(source: Path, output: Path, following: Any, ended: Any, ready: Any, leave: Any) -> None:
    runs = [Run(*one) for one in json.loads(source.read_text())]
    warm_up()
    found: list[tuple[str, dict[str, Any]]] = []
    ready.wait()
    while True:
        with following.get_lock():
            number = following.value
            following.value += 1
        if number >= len(runs):
            break
        found.append((runs[number].id, _solve(runs[number])))
        with ended.get_lock():
            ended.value += 1
    # Alive until then, so that the time that it took can be read.
    leave.wait()
    output.write_text("".join(json.dumps(one) + "\n" for one in found))


def _solve(run: Run) -> dict[str, Any]:
    """As a worker does a whole run that holds nothing out."""
    problem = fit_problem(CalibrationRun(problem=run.document, fold=-1), run.pairs)
    state, _ = run_schedule(problem)
    return solve_finish(problem, state)
