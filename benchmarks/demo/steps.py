"""Progress of the demo's steps: bars on a terminal, one line for each finished step elsewhere."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from apexcal.commands.session import OnProgress, Reply, Session


class DemoSteps:
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

    def __enter__(self) -> DemoSteps:
        self._progress.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._progress.stop()

    @contextmanager
    def step(self, half: str, title: str) -> Iterator[OnProgress]:
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


class DemoSession(Session):
    """Runs commands of ``apexcal`` as steps of one half of the demo."""

    def __init__(self, steps: DemoSteps, half: str, url: str, token: str) -> None:
        super().__init__(url, token, as_json=True)
        self.steps, self.half = steps, half

    def step(self, title: str) -> Any:
        """One step of this half: :meth:`DemoSteps.step`."""
        return self.steps.step(self.half, title)

    @contextmanager
    def progress(self, title: str) -> Iterator[OnProgress]:
        """The progress of the running step."""
        yield self._on_progress

    def run(self, title: str, command: Callable[..., Reply], *words: Any, **options: Any) -> Any:
        """Run a command as one step, show the first line of what it says, and return its document."""
        with self.step(title) as self._on_progress:
            reply = command(self, *words, **options)
            text = [part for part in [reply.text] if isinstance(part, str)]
            self._on_progress(1.0, "".join(text).partition("\n")[0])
        return reply.document
