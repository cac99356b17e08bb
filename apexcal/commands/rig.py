"""``apexcal rig`` tells the service how a vehicle's sensors are mounted."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import Annotated, TypeVar

import typer

from apexcal.client import Client
from apexcal.commands.named import pick
from apexcal.commands.session import Reply, Session
from apexcal.commands.terminal import note
from apexcal.documents.fleets import FleetOut, NewRig, RigOut, VehicleOut
from apexcal.rigs import read_rig
from apexcal.transport import Document

New = TypeVar("New", FleetOut, VehicleOut)


def rig(
    session: Session,
    description: Annotated[Path | None, typer.Argument(exists=True)] = None,
    fleet: str = "",
    vehicle: str = "Vehicle",
    correct: str = "",
    images: list[str] | None = None,
) -> Reply:
    """Add a rig to a vehicle: its LiDAR, its cameras and roughly where they are. Or correct what its images are.

    Args:
        description: JSON file of the rig: docs/rigs.md.
        fleet: Fleet, by name; a new name makes one. Needed where there are several.
        vehicle: Vehicle, by name; a new name makes one.
        correct: Id of a rig: its --images are corrected, and none is added.
        images: CAMERA=raw or =rectified; CAMERA= forgets it.
    """
    if bool(description) == bool(correct) or bool(correct) != bool(images):
        raise typer.BadParameter("Give a description, or --correct with --images.")
    client = session.client
    if description is None:
        words = (text.partition("=") for text in images or ())
        kinds = {camera: {"kind": kind} if kind else None for camera, _, kind in words}
        corrected = client.vehicles.set_images(correct, kinds, version=client.vehicles.rig(correct).version)
        return Reply(corrected, f"The images of the rig {corrected.name!r} are corrected.")
    added, where = add_rig(client, read_rig(description), fleet, vehicle)
    return Reply(added, f"The rig {added.name!r} of {where} is {added.id}.")


def add_rig(
    client: Client, document: Document, fleet: str, vehicle: str, *, again: bool = False
) -> tuple[RigOut, str]:
    """Add a rig to a vehicle, which is made if there is none of this name. Return it, and whose it is.

    ``again``: a rig of the vehicle that says the same is taken, and a name that is taken gets a number.
    """
    in_fleet = _fleet(client, fleet)
    on_vehicle = _vehicle(client, in_fleet, vehicle) if in_fleet else None
    if in_fleet is None or on_vehicle is None:
        # Nothing is made for a rig that would be refused.
        client.vehicles.check_rig(document)
        in_fleet = in_fleet or _noted("fleet", client.fleets.create(fleet or "Fleet"))
        on_vehicle = _noted("vehicle", client.vehicles.create(in_fleet.id, vehicle))
    where = f"{on_vehicle.name} in the fleet {in_fleet.name}"
    before = list(client.vehicles.rigs(on_vehicle.id)) if again else []
    if before:
        client.vehicles.check_rig(document)
        described = _mounts(NewRig.model_validate(document))
        same = next((existing for existing in before if _mounts(existing) == described), None)
        if same is not None:
            return same, where
    names = {existing.name for existing in before}
    free = next(name for name in _numbered(document["name"]) if name not in names)
    return client.vehicles.create_rig(on_vehicle.id, document | {"name": free}), where


def _mounts(rig: RigOut | NewRig) -> Document:
    """Show the rig with which a recording is read and at which a search begins."""
    document = rig.model_dump(mode="json", include={"lidar", "cameras", "T_vehicle_lidar"})
    return document | {"cameras": [camera | {"images": None} for camera in document["cameras"]]}


def _numbered(name: str) -> Iterator[str]:
    yield name
    yield from (f"{name} {number}" for number in count(2))


def _fleet(client: Client, name: str) -> FleetOut | None:
    """The fleet of this id or name, or the only one; None where it is to be made. Asks where there are several."""
    fleets = list(client.fleets.list())
    if not name:
        return pick(client, fleets, "fleet", name) if fleets else None
    return next((fleet for fleet in fleets if name in (str(fleet.id), fleet.name)), None)


def _vehicle(client: Client, fleet: FleetOut, name: str) -> VehicleOut | None:
    return next((each for each in client.vehicles.list(fleet.id) if name in (str(each.id), each.name)), None)


def _noted(what: str, thing: New) -> New:
    """Say at once that a thing was made, so that it is known whatever comes after."""
    note(f"Made the {what} {thing.name!r}.")
    return thing
