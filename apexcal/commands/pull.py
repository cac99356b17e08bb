"""``apexcal pull``: what a vehicle is given, kept in a file. For start-up scripts."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import Final

import httpx
import typer

from apexcal.commands.session import locate
from apexcal.commands.terminal import note, write_content
from apexcal.embedded.folder import DEFAULT
from apexcal.pull_alone import options_parser
from apexcal.pull_alone import pull as pull_alone

_PROGRAM: Final = ("archives", "errors", "http_rules", "kept_file", "pull_alone")
"""Modules of the program that `--program` writes. Each needs Python 3.8 and imports only those before it."""


def pull(context: typer.Context) -> None:
    """Keep what a vehicle is given now (all its cameras) in a file: :mod:`apexcal.pull_alone`."""
    options = pull_parser().parse_args(context.args)
    if options.program:
        output = Path(options.output)
        write_content(output, program_source())
        note(f"{output} is the program: python3 {output.name} --help")
        return
    options.url, options.token, _ = locate(options.url, options.token, options.data)
    pull_alone(options, httpx.create_ssl_context())


def pull_parser() -> argparse.ArgumentParser:
    """The program's options, and those of the command alone."""
    parser = options_parser("apexcal pull")
    parser.add_argument("--data", type=Path, default=DEFAULT, help="data folder of a service on this machine")
    parser.add_argument(
        "--program", action="store_true", help="write the program itself to OUTPUT, one file for Python 3.8 and newer"
    )
    return parser


def program_source() -> str:
    """Return `apexcal pull` as the source of one program of the standard library alone."""
    folder = Path(__file__).parents[1]
    sources = [(folder / f"{name}.py").read_text(encoding="utf-8") for name in _PROGRAM]
    ours = re.compile(r"^from (?:__future__|apexcal\.\w+) import (?:\([^)]*\)|.*)\n", re.M)
    modules = [ours.sub("", text) for text in sources]
    return "\n\n".join(["#!/usr/bin/env python3\nfrom __future__ import annotations", *modules])
