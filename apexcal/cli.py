"""The command ``apexcal``. Exit codes: 0 done; 1 the service refused or failed; 2 wrong usage; 3 no answer;
4 done, but a check kept a result from being published.

Each subcommand lives in a module of its own, loaded when it is called: ``apexcal --help`` loads none.
"""

from __future__ import annotations

import importlib
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

OK, FAILED, USAGE, UNREACHABLE, WITHHELD = 0, 1, 2, 3, 4

# Name -> what `apexcal --help` says of it. The module is apexcal.commands.<name>, its function has the same name;
# hyphens become underscores there.
COMMANDS = {
    "serve": "Start the whole service on this machine.",
    "worker": "Start a worker of a fleet on this host.",
    "simulate": "Write a simulated recording with its ground truth.",
    "invite": "Make a one-time sign-in link for a person.",
    "token": "Make an API token for a program.",
    "rig": "Describe a vehicle's LiDAR and cameras to the service.",
    "draft-rig": "Write a rig's description from a URDF or a recording's /tf_static.",
    "upload": "Upload a recording and wait until it is ready.",
    "reread": "Read again a recording that failed.",
    "suggest": "Suggest a region of interest from what moves.",
    "detect": "Find the board's vertices in a recording.",
    "clock-offset": "Estimate how far the camera's clock is from the LiDAR's.",
    "calibrate": "Calibrate a camera from marks or from a file of pairs.",
    "validate": "Test a calibration on other pairs, or on a drive.",
    "drift": "Compare a camera's results over time.",
    "admin": "Back up, restore and maintain a service.",
    "publish": "Make a result its camera's current calibration.",
    "publications": "List a camera's publications, by whom and why.",
    "withdraw": "Take back a camera's current calibration.",
    "alias": "List and move a camera's aliases, such as canary.",
    "rollback": "Restore a camera's previous calibration.",
    "calibrate-fleet": "Calibrate all vehicles of a fleet that a filter names.",
    "pull": "Keep what a vehicle is given now in a file.",
    "copy": "Copy a recording's bag and write the published calibration into it.",
    "compare": "Compare a camera's calibration with another result or another program's file.",
    "recalibrate": "Calibrate again without some of a result's pairs.",
    "report": "Write the report of a result, with its verdict, as one HTML file.",
    "overlay": "Draw a sweep into its frame through a result's lens, as a PNG file.",
    "export": "Write a camera's current calibration, or one result, for other programs.",
}


class _Commands(TyperGroup):
    """Shows its commands by name and sentence, and loads the one that is called."""

    def list_commands(self, ctx: Any) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> TyperCommand | None:
        return TyperCommand(cmd_name, help=COMMANDS[cmd_name]) if cmd_name in COMMANDS else None

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        name, found, rest = super().resolve_command(ctx, args)
        if found is None or found.name not in COMMANDS:
            return name, found, rest
        word = found.name.replace("-", "_")
        module = importlib.import_module(f"apexcal.commands.{word}")
        lone = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
        lone.command(found.name, cls=getattr(module, "COMMAND", None))(getattr(module, word))
        return name, typer.main.get_command(lone), rest


app = typer.Typer(cls=_Commands, no_args_is_help=True, pretty_exceptions_enable=False, rich_markup_mode=None)


@app.callback()
def apexcal() -> None:
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
