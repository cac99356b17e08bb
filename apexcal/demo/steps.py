"""Progress of the demo's steps: bars on a terminal, one line for each finished step elsewhere."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

Report = Callable[[float, str], None]


class Steps:
    """Several steps may run at once, each in a thread of its own."""

    def __init__(self, out: Console) -> None:
        self._out = out
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=28),
            TaskProgressColumn(),
            TimeElapsedColumn(),
            TextColumn("[dim]{task.fields[message]}"),
            console=out,
            disable=not out.is_terminal,
        )

    def __enter__(self) -> Steps:
        self._progress.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._progress.stop()

    @contextmanager
    def step(self, half: str, title: str) -> Iterator[Report]:
        """One step. The yielded function takes a fraction and a message; the last message stays visible."""
        name = f"{half:<9} {title:<26}"
        task = self._progress.add_task(escape(name), total=1.0, message="")
        began = time.monotonic()
        last = ""

        def report(fraction: float, message: str) -> None:
            nonlocal last
            last = message
            self._progress.update(task, completed=min(fraction, 1.0), message=escape(message))

        yield report
        self._progress.update(task, completed=1.0, message=escape(last))
        self._progress.stop_task(task)
        if not self._out.is_terminal:
            self._out.print(f"{name} {time.monotonic() - began:6.1f} s  {last}", markup=False, soft_wrap=True)
