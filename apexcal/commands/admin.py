"""``apexcal admin``: the operator's commands, which work on the service's own database and store."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from typing import Any

import typer
from typer.core import TyperCommand


class COMMAND(TyperCommand):
    """Passes every argument on, `--help` too, because the service defines these commands."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        kwargs["context_settings"] = {"ignore_unknown_options": True, "allow_extra_args": True}
        super().__init__(*args, **{**kwargs, "add_help_option": False})


def admin(context: typer.Context) -> None:
    """Look after a service: back up and restore, people, jobs, retention."""
    command = (sys.executable, "-m", "service.admin", *folder_first(context.args))
    os.execve(command[0], command, {**os.environ, "APEXCAL_ADMIN_NAME": "apexcal admin"})


def folder_first(words: Sequence[str]) -> list[str]:
    """The words with ``--data FOLDER`` moved to the front, where the service's command line looks for it.

    All other commands of apexcal take ``--data`` after their own name, so people write it there.
    """
    first: list[str] = []
    rest: list[str] = []
    left = iter(words)
    for word in left:
        folder = next(left, None) if word == "--data" else None
        if folder is not None:
            first += [word, folder]
        elif word.startswith("--data="):
            first.append(word)
        else:
            rest.append(word)
        if word == "--":
            rest += left
    return first + rest
