"""The command's parser: an option for each field of `SimulationOptions`, in groups."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from pydantic import ValidationError

from apexcal.documents.simulation import Disturbances, SimulationOptions

EXAMPLES = """\
examples:
  apexcal simulate --out walk
      two minutes of a VLP-16 and a front camera, as a ROS 1 bag
  apexcal simulate --out rig3 --cameras front,left,right --format mcap
      three cameras, as a ROS 2 bag
  apexcal simulate --out far --sensor os1-64 --walk field --board 1.0x1.0 --seconds 300
      would a larger board do for the far half of the field?
  apexcal simulate --out real --beam-mrad 3 --dropouts 0.05 --clock-offset-ms 30 --second-person beside
      as untidy as a real recording"""
_GROUPS = ("Recording", "LiDAR", "Cameras", "Walk", "What is in the way")


def parser() -> argparse.ArgumentParser:
    """The parser of ``python -m workers.simulation``, which is also the command ``apexcal simulate``."""
    command = argparse.ArgumentParser(
        prog=os.environ.get("APEXCAL_COMMAND", "python -m workers.simulation"),
        description="Simulate a rig: a spinning LiDAR, cameras beside it, and a person who carries a board\n"
        "turned by 45 degrees through the field in front. Writes a recording as the sensors'\n"
        "drivers would, the ground truth (truth.json), the rig as its owner would describe it\n"
        "(rig.json), and where the person walks as a region of interest (region.json).",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog=EXAMPLES,
    )
    command.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder to write into")
    command.add_argument("--json", action="store_true", help="print the summary as one JSON object")
    command.add_argument("--progress-json", action="store_true", help="print progress too, as JSON lines")
    groups = {name: command.add_argument_group(name) for name in _GROUPS}
    for name in sorted(SimulationOptions.model_fields, key=Disturbances.model_fields.__contains__):
        field = SimulationOptions.model_fields[name]
        shown: Any = field.json_schema_extra
        choices = get_args(field.annotation) if get_origin(field.annotation) is Literal else ()
        text = f"{field.description} [default: {field.default}]"
        groups[shown["group"]].add_argument(
            f"--{name.replace('_', '-')}",
            metavar="{" + ",".join(choices) + "}" if choices else shown["metavar"],
            help=text.replace("%", "%%"),
            default=argparse.SUPPRESS,
        )
    return command


def options_of(words: argparse.Namespace) -> SimulationOptions:
    """Parse the words of a command. Raises ValueError with one sentence for options that cannot be."""
    named = {name: text for name, text in vars(words).items() if name in SimulationOptions.model_fields}
    try:
        return SimulationOptions.model_validate(named)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        option = "".join(f"--{name}: " for name in first["loc"]).replace("_", "-")
        if first["type"] == "value_error":
            raise ValueError(f"{option}{first['msg'].removeprefix('Value error, ')}.") from None
        raise ValueError(f"{option}{first['msg']}, not {first['input']!r}.") from None
