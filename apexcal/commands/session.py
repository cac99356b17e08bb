"""The common part of commands that work with a service: options, client, progress, errors as sentences, the reply."""

from __future__ import annotations

import inspect
import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeVar, cast, get_type_hints

import typer
from pydantic import BaseModel
from rich.console import RenderableType
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from apexcal.client import ApiError, Client, ClientError, InputError, TokenError, UnreachableError, Work
from apexcal.commands.terminal import FAILED, UNREACHABLE, USAGE, complain, console, note, usage
from apexcal.documents.base import visible
from apexcal.documents.served_folder import is_served, read_status
from apexcal.embedded.folder import DEFAULT

# At a fraction, with a message.
OnProgress = Callable[[float, str], None]
Run = TypeVar("Run", bound=Callable[..., Any])

TOKEN_HINT = "An engineer makes one with `apexcal token NAME --role ROLE --link LINK`, the owner without a link"


class Reply(NamedTuple):
    """A command's answer: the document for programs, sentences and tables for people, the exit code, and the
    command that comes ``next``, with real ids.
    """

    document: Any
    text: str | list[RenderableType]
    exit_code: int = 0
    next: str = ""

    def print(self, *, as_json: bool) -> None:
        """Print one of the two on standard output."""
        if as_json:
            print(visible(json.dumps(as_document(self.document), indent=2, ensure_ascii=False), "\n"))
            return
        for part in [self.text] if isinstance(self.text, str) else self.text:
            console().print(escape(part) if isinstance(part, str) else part, soft_wrap=isinstance(part, str))
        if self.next:
            note(f"Next: {self.next}")


@dataclass
class Session:
    """One call of a command. Its fields are the options of every command that works with a service."""

    url: Annotated[
        str, typer.Option("--url", envvar="APEXCAL_URL", help="Address of the service.", show_default=False)
    ] = ""
    token: Annotated[
        str, typer.Option("--token", envvar="APEXCAL_TOKEN", help="API token.", show_default=False, show_envvar=True)
    ] = ""
    data: Annotated[Path, typer.Option("--data", help="Data folder of a service on this machine.")] = DEFAULT
    as_json: Annotated[bool, typer.Option("--json", help="Print the outcome as JSON, and no progress.")] = False

    @cached_property
    def client(self) -> Client:
        """The service's client. Nothing is looked for before the first use, so wrong options are said first."""
        return self.connect()

    def connect(self, timeout_s: float | None = None) -> Client:
        """Connect to the service. Ends the command where none runs, or the address or the token can be none."""
        address, secret, origin = locate(self.url, self.token, self.data)
        self.token_origin = origin
        try:
            self.client = Client(address, secret, timeout_s)
        except TokenError as error:
            usage(str(TokenError(origin)), error.hint)
        except (InputError, ValueError) as error:
            usage(str(error), getattr(error, "hint", "Give it with --url or APEXCAL_URL"))
        return self.client

    def close(self) -> None:
        """Close the client, if there is one."""
        if "client" in self.__dict__:
            self.client.close()

    @contextmanager
    def progress(self, title: str) -> Iterator[OnProgress]:
        """A progress bar on standard error."""
        columns = (
            TextColumn("{task.description}"),
            BarColumn(bar_width=30),
            TaskProgressColumn(),
            TimeElapsedColumn(),
            TextColumn("[dim]{task.fields[message]}"),
        )
        is_shown = not self.as_json and sys.stderr.isatty() and "NO_PROGRESS" not in os.environ
        with Progress(*columns, console=console(errors=True), disable=not is_shown) as progress:
            task = progress.add_task(f"{title:<24}", total=1.0, message="")
            yield lambda fraction, message: progress.update(task, completed=fraction, message=escape(message))

    def wait(self, work: Work, title: str) -> Work:
        """Follow work of the service to its end with a progress bar."""
        with self.progress(title) as on_progress:
            return self.client.wait(work, on_progress=on_progress)

    @contextmanager
    def saying_errors(self) -> Iterator[None]:
        """Say in a sentence what goes wrong inside the block, and end the command with its exit code."""
        try:
            yield
        except UnreachableError as error:
            complain(str(error), error.hint, code=UNREACHABLE)
        except ApiError as error:
            complain(*self._refusal(error), code=USAGE if error.is_about_the_input else FAILED)
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            complain(f"cannot read {error.filename}: {reason}" if error.filename else reason)
        except UnicodeEncodeError:
            complain("a name or path holds bytes that are no UTF-8", "Write it again in this terminal.")
        except InputError as error:
            usage(str(error), error.hint)
        except (ClientError, ValueError) as error:
            complain(str(error), getattr(error, "hint", ""))

    def _refusal(self, error: ApiError) -> tuple[str, str]:
        """Say what the service refused and what to do, with a line for every field that it names."""
        refused = error.refused_fields
        if len(refused) > 1:
            lines = "".join(f"\n  {field}" for field in refused)
            return f"the service refused {len(refused)} fields ({error.code}):{lines}", "Correct them and try again."
        hint = "Correct it and try again." if refused else error.hint
        if error.code == "not_signed_in":
            hint = f"The token is {self.token_origin}; give a valid one with --token or APEXCAL_TOKEN. {TOKEN_HINT}."
        return f"{str(error).rstrip('.')} ({error.code})", hint


def with_session(run: Run) -> Run:
    """Give a function whose first parameter is a session the session's options, as a command has them.

    It prints the reply that the function returns. A function that returns none has no ``--json``.
    """
    first, *own = inspect.signature(run, eval_str=True).parameters.values()
    hints = get_type_hints(run, include_extras=True)
    if hints[first.name] is not Session:
        return run
    shared = [
        inspect.Parameter(field.name, inspect.Parameter.KEYWORD_ONLY, default=field.default, annotation=hint)
        for field, hint in zip(fields(Session), get_type_hints(Session, include_extras=True).values(), strict=True)
        if hints["return"] is Reply or field.name != "as_json"
    ]

    def command(**options: Any) -> None:
        session = Session(**{each.name: options.pop(each.name) for each in shared})
        with session.saying_errors():
            try:
                reply = run(session, **options)
            finally:
                session.close()
        if reply is not None:
            reply.print(as_json=session.as_json)
            raise typer.Exit(reply.exit_code)

    parameters = [*(each.replace(kind=inspect.Parameter.KEYWORD_ONLY) for each in own), *shared]
    command.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    command.__annotations__ = {each.name: each.annotation for each in parameters}
    command.__doc__ = run.__doc__
    return command  # type: ignore[return-value]


def locate(url: str, token: str, data: Path) -> tuple[str, str, str]:
    """Address and token of the service, and where the token is from.

    Both as given, else those of the service on this machine's data folder.
    """
    local = str(read_status(data).get("url") or "") if is_served(data) else ""
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
    if isinstance(outcome, BaseModel):
        return outcome.model_dump(mode="json", exclude_unset=True)
    if isinstance(outcome, Mapping):
        return {name: as_document(each) for name, each in cast(Mapping[str, Any], outcome).items()}
    return [as_document(each) for each in cast(list[Any], outcome)] if isinstance(outcome, list) else outcome
