"""Output of commands: sentences on the terminal, outcomes into files."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import NoReturn

import typer
from rich.console import Console, ConsoleOptions, RenderableType
from rich.markup import escape
from rich.segment import Segment

from apexcal.documents.base import visible
from apexcal.errors import as_sentence
from apexcal.kept_file import replace_whole

FAILED, USAGE, UNREACHABLE, WITHHELD = 1, 2, 3, 4  # exit codes, as `apexcal.cli` says


class _Terminal(Console):
    """A console that spells out what cannot be seen, so that no name sends commands to the terminal."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """The pieces that are written."""
        for piece in super().render(renderable, options):
            yield piece if piece.control else Segment(visible(piece.text, "\n"), piece.style)


def console(*, errors: bool = False) -> Console:
    """The terminal: results on standard output, everything else on standard error."""
    return _Terminal(stderr=errors, highlight=False)


def note(sentence: str) -> None:
    """Say what is no result: on standard error."""
    console(errors=True).print(sentence, markup=False, soft_wrap=True)


def complain(sentence: str, hint: str = "", *, code: int = FAILED) -> NoReturn:
    """Say what is wrong and what to do, and leave."""
    console(errors=True).print(f"[bold red]apexcal:[/] {escape(as_sentence(sentence))}", soft_wrap=True)
    if hint:
        note(as_sentence(hint))
    raise typer.Exit(code)


def usage(sentence: str, hint: str = "") -> NoReturn:
    """Say that the command was called wrongly, and leave."""
    complain(sentence, hint, code=USAGE)


def check_target(file: Path, force: bool) -> None:
    """End the command, before it does anything, if its outcome could not be written to this file."""
    if file.is_dir():
        usage(f"{file} is a folder", "Name a file in it")
    if not file.parent.is_dir():
        usage(f"there is no folder {file.parent}", "Make it first, or name a file elsewhere")
    if file.exists() and not force:
        usage(f"{file} exists already", "Name another file, or say --force")


def write_content(file: Path, content: bytes | str) -> None:
    """Write a file that a command made, and its folder; an existing one is replaced whole, or the command fails."""
    content = content.encode() if isinstance(content, str) else content
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        if file.is_file() and not file.is_symlink():
            replace_whole(file, content, file.name)
        else:  # new, a link, or a device such as /dev/stdout
            file.write_bytes(content)
    except OSError as error:
        complain(f"cannot write {file}: {(error.strerror or '').lower()}")
