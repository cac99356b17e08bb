"""``apexcal rig``: tells the service how a vehicle's sensors are mounted."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, TypeVar

import typer

from apexcal.client import Client
from apexcal.commands.common import DataOption, JsonOption, TokenOption, UrlOption, console, say
from apexcal.commands.connect import connected, pick
from apexcal.documents.fleets import FleetOut, VehicleOut
from apexcal.embedded.folder import DEFAULT
from apexcal.rigs import read_rig

Made = TypeVar("Made", FleetOut, VehicleOut)


def rig(
    description: Annotated[
        Path | None, typer.Argument(help="JSON file of the rig: docs/rigs.md.", exists=True)
    ] = None,
    fleet: Annotated[
        str, typer.Option(help="Fleet, by name; a new name makes one. Needed where there are several.")
    ] = "",
    vehicle: Annotated[str, typer.Option(help="Vehicle, by name; a new name makes one.")] = "Vehicle",
    correct: Annotated[str, typer.Option(help="Id of a rig: its --images are corrected, and none is added.")] = "",
    images: Annotated[list[str] | None, typer.Option(help="CAMERA=raw or =rectified; CAMERA= forgets it.")] = None,
    url: UrlOption = "",
    token: TokenOption = "",
    data: DataOption = DEFAULT,
    as_json: JsonOption = False,
) -> None:
    """Add a rig to a vehicle: its LiDAR, its cameras and roughly where they are. Or correct what its images are."""
    if bool(description) == bool(correct) or bool(correct) != bool(images):
        raise typer.BadParameter("Give a description, or --correct with --images.")
    with connected(url, token, data) as client:
        if description is None:
            words = (text.partition("=") for text in images or ())
            kinds = {camera: {"kind": kind} if kind else None for camera, _, kind in words}
            corrected = client.vehicles.set_images(correct, kinds, version=client.vehicles.rig(correct).version)
            say(corrected, as_json, f"The images of the rig {corrected.name!r} are corrected.")
            return
        document = read_rig(description)
        in_fleet = _fleet(client, fleet)
        on_vehicle = _vehicle(client, in_fleet, vehicle) if in_fleet else None
        if on_vehicle is None:
            # Nothing is made for a rig that would be refused.
            client.vehicles.check_rig(document)
            in_fleet = in_fleet or _made("fleet", client.fleets.create(fleet or "Fleet"))
            on_vehicle = _made("vehicle", client.vehicles.create(in_fleet.id, vehicle))
        made = client.vehicles.create_rig(on_vehicle.id, document)
    where = f"{on_vehicle.name} in the fleet {in_fleet.name}" if in_fleet else on_vehicle.name
    say(made, as_json, f"The rig {made.name!r} of {where} is {made.id}.")


def _fleet(client: Client, wanted: str) -> FleetOut | None:
    """The fleet of this id or name, or the only one; None where it is to be made. Asks where there are several."""
    fleets = list(client.fleets.list())
    if not wanted:
        return pick(fleets, "fleet", wanted, "with --fleet") if fleets else None
    return next((fleet for fleet in fleets if wanted in (str(fleet.id), fleet.name)), None)


def _vehicle(client: Client, fleet: FleetOut, wanted: str) -> VehicleOut | None:
    return next((each for each in client.vehicles.list(fleet.id) if wanted in (str(each.id), each.name)), None)


def _made(what: str, thing: Made) -> Made:
    """Say at once that a thing was made, so that it is known whatever comes after."""
    console(errors=True).print(f"Made the {what} {thing.name!r}.", markup=False, soft_wrap=True)
    return thing
