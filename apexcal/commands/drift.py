"""``apexcal drift``: a camera's results in their order, each compared with the one before and with the first."""

from __future__ import annotations

from typing import Annotated

import typer

from apexcal.commands.common import DataOption, JsonOption, TokenOption, UrlOption, say
from apexcal.commands.connect import connected, find_vehicle
from apexcal.documents.validations import DriftDifference, DriftStep
from apexcal.embedded.folder import DEFAULT


def drift(
    vehicle: Annotated[str, typer.Argument(help="Vehicle, by id or by name.")],
    camera: Annotated[str, typer.Option(help="Camera, by its name in the rig.")],
    limit: Annotated[int, typer.Option(help="How many of the newest results at most.", min=2, max=100)] = 20,
    fleet: Annotated[str, typer.Option(help="Fleet, by id or name; needed where there are several.")] = "",
    url: UrlOption = "",
    token: TokenOption = "",
    data: DataOption = DEFAULT,
    as_json: JsonOption = False,
) -> None:
    """Compare a camera's recommended results over time: how far the mount moved, and whether more than chance."""
    with connected(url, token, data) as client:
        found = client.validations.drift(find_vehicle(client, fleet, vehicle).id, camera, limit=limit)
    say(found, as_json, "\n".join([found.sentence, *map(_line, found.steps)]))


def _line(step: DriftStep) -> str:
    return (
        f"  {step.at:%Y-%m-%d %H:%M}  {step.model:15}  {step.result_id}"
        f"  before: {_apart(step.from_previous)}  first: {_apart(step.from_first)}"
    )


def _apart(difference: DriftDifference | None) -> str:
    if difference is None:
        return "-"
    size = f"{difference.rotation_deg:.3f} deg {difference.translation_mm:.0f} mm {difference.sigmas:.1f} sigmas"
    return f"{size} (differs)" if difference.differs else size
