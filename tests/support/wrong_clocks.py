"""Clocks of day of single processes, set while these run. Timers and monotonic clocks go on, as on a real host."""

from __future__ import annotations

import shutil
import subprocess
from functools import cache
from pathlib import Path

_SOURCE = Path(__file__).with_name("wrong_clock.c")


@cache
def why_not() -> str:
    """Why no clock can be set here, in words; empty where it can."""
    return "" if shutil.which("cc") else "a C compiler is missing"


class WrongClock:
    """The clock of every process that is started with its environment."""

    def __init__(self, folder: Path, name: str) -> None:
        library = folder / "wrong_clock.so"
        if not library.exists():
            command = ["cc", "-shared", "-fPIC", "-O1", "-o", str(library), str(_SOURCE), "-ldl"]
            subprocess.run(command, check=True, capture_output=True)
        self._file = folder / f"{name}.clock"
        self._file.write_text("0")
        self.environment = {"LD_PRELOAD": str(library), "WRONG_CLOCK": str(self._file)}

    def step(self, seconds: int) -> None:
        """Set it to so many seconds beside the truth."""
        with self._file.open("r+b") as file:
            file.write(f"{seconds:<12d}\n".encode())
