"""`apexcal serve` as a process of its own."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from apexcal.embedded.folder import read_status
from apexcal.processes import tied_to_this

SERVE = (sys.executable, "-m", "apexcal.cli", "serve", "--port", "0", "--workers", "2", "--json")


@dataclass
class Embedded:
    """A running service, its folder, and what it said of itself when it was up."""

    process: subprocess.Popen[str]
    data: Path
    said: dict[str, str]

    @property
    def url(self) -> str:
        return self.said["url"]

    @property
    def token(self) -> str:
        return (self.data / "owner.token").read_text().strip()

    def children(self) -> dict[str, dict[str, Any]]:
        return {child["name"]: child for child in read_status(self.data).get("children", [])}


def start(data: Path, *more: str, environment: Mapping[str, str] | None = None) -> Embedded:
    """Start it, and wait until it is up."""
    command = [*SERVE, "--data", str(data), *more]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment, preexec_fn=tied_to_this())
    assert process.stdout
    line = process.stdout.readline()
    assert line, f"the service did not start: exit code {process.wait()}"
    return Embedded(process, data, json.loads(line))


def stop(embedded: Embedded) -> int:
    """Tell it to stop, and wait until it has; its exit code."""
    embedded.process.terminate()
    code = embedded.process.wait()
    if embedded.process.stdout:
        embedded.process.stdout.close()
    return code


@contextmanager
def serving(data: Path, *more: str, environment: Mapping[str, str] | None = None) -> Iterator[Embedded]:
    """Have it for a block."""
    embedded = start(data, *more, environment=environment)
    try:
        yield embedded
    finally:
        stop(embedded)
