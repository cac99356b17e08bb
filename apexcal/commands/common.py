"""Shared by the subcommands: options that find the service, output, progress bars, exit codes."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer
from pydantic import BaseModel
from rich.console import Console, ConsoleOptions, RenderableType
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.segment import Segment

from apexcal.cli import FAILED, UNREACHABLE, USAGE
from apexcal.documents.served_folder import is_served, read_status
from apexcal.errors import InputError, as_sentence
from apexcal.kept_file import replace_whole

UrlOption = Annotated[
    str, typer.Option("--url", envvar="APEXCAL_URL", help="Address of the service.", show_default=False)
]
TokenOption = Annotated[
    str, typer.Option("--token", envvar="APEXCAL_TOKEN", help="API token.", show_default=False, show_envvar=True)
]
DataOption = Annotated[Path, typer.Option("--data", help="Data folder of a service on this machine.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print the outcome as JSON, and no progress.")]

TOKEN_HINT = "An engineer makes one with `apexcal token NAME --role ROLE --link LINK`, the owner without a link"


class _Terminal(Console):
    """A console that spells out what cannot be seen, so that no name sends commands to the terminal."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """The pieces that are written."""
        for piece in super().render(renderable, options):
            yield piece if piece.control else Segment(visible(piece.text), piece.style)


def visible(text: str) -> str:
    """The text, its line ends kept, with everything else that cannot be seen spelled as in JSON."""
    if text.isprintable():
        return text
    return "".join(one if one.isprintable() or one == "\n" else json.dumps(one)[1:-1] for one in text)


def console(*, errors: bool = False) -> Console:
    """The terminal: results on standard output, everything else on standard error."""
    return _Terminal(stderr=errors, highlight=False)


def complain(sentence: str, hint: str = "", *, code: int = FAILED) -> NoReturn:
    """Say what is wrong and what to do, and leave."""
    out = console(errors=True)
    out.print(f"[bold red]apexcal:[/] {escape(as_sentence(sentence))}", soft_wrap=True)
    if hint:
        out.print(escape(as_sentence(hint)), soft_wrap=True)
    raise typer.Exit(code)


def usage(sentence: str, hint: str = "") -> NoReturn:
    """Say that the command was called wrongly, and leave."""
    complain(sentence, hint, code=USAGE)


@contextmanager
def understood() -> Iterator[None]:
    """What cannot be read or sent inside the block is said before anything is asked of the service."""
    try:
        yield
    except InputError as error:
        usage(str(error), error.hint)


def check_target(file: Path, force: bool) -> None:
    """End the command, before it does anything, if its outcome could not be written to this file."""
    if file.is_dir():
        usage(f"{file} is a folder", "Name a file in it")
    if not file.parent.is_dir():
        usage(f"there is no folder {file.parent}", "Make it first, or name a file elsewhere")
    if file.exists() and not force:
        usage(f"{file} exists already", "Name another file, or say --force")


def write_target(file: Path, text: str) -> None:
    """Write the outcome of a command to a file, or end the command as failed."""
    try:
        file.write_text(text, encoding="utf-8")
    except OSError as error:
        complain(f"cannot write {file}: {(error.strerror or '').lower()}")


def write_content(file: Path, content: bytes) -> None:
    """Write a file that a command made, and its folder; an existing one is replaced whole, or the command fails."""
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        if file.is_file() and not file.is_symlink():
            replace_whole(file, content, file.name)
        else:  # new, a link, or a device such as /dev/stdout
            file.write_bytes(content)
    except OSError as error:
        complain(f"cannot write {file}: {(error.strerror or '').lower()}")


def locate(url: str, token: str, data: Path) -> tuple[str, str, str]:
    """Address and token of the service, and where the token is from.

    Both as given, else those of the service on this machine's data folder.
    """
    served = is_served(data)
    local = str(read_status(data).get("url") or "") if served else ""
    if not url and not local:
        complain(
            f"no service runs on {data.resolve()}",
            "Start one with `apexcal serve`, name its folder with --data, or say where it is: --url and --token, or "
            "APEXCAL_URL and APEXCAL_TOKEN",
            code=UNREACHABLE,
        )
    origin = "APEXCAL_TOKEN" if token == os.environ.get("APEXCAL_TOKEN") else "what --token gives"
    if not token and (not url or url.rstrip("/") == local):
        file = data / "owner.token"
        try:
            token, origin = file.read_text(encoding="utf-8", errors="replace").strip(), f"what {file} holds"
        except OSError:
            token = ""
    if not token:
        usage("no token", f"Give --token or APEXCAL_TOKEN. {TOKEN_HINT}")
    return url or local, token, origin


def as_document(outcome: Any) -> Any:
    """Answers of the service as they came, members that this version does not know included."""
    if isinstance(outcome, list):
        return [as_document(one) for one in outcome]
    return outcome.model_dump(mode="json", exclude_unset=True) if isinstance(outcome, BaseModel) else outcome


def say(outcome: Any, as_json: bool, sentence: str) -> None:
    """The outcome of a command: a sentence for people, or the whole document for programs."""
    if as_json:
        print(visible(json.dumps(as_document(outcome), indent=2, ensure_ascii=False)))
    else:
        console().print(escape(sentence), soft_wrap=True)


@contextmanager
def bar(title: str, shown: bool = True) -> Iterator[Callable[[float, str], None]]:
    """A progress bar on standard error; the yielded function takes a fraction and a message."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(bar_width=30),
        TaskProgressColumn(),
        TimeElapsedColumn(),
        TextColumn("[dim]{task.fields[message]}"),
    )
    shown = shown and sys.stderr.isatty() and "NO_PROGRESS" not in os.environ
    with Progress(*columns, console=console(errors=True), disable=not shown) as progress:
        task = progress.add_task(f"{title:<24}", total=1.0, message="")
        yield lambda fraction, message: progress.update(task, completed=fraction, message=escape(message))
