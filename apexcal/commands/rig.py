"""``apexcal rig`` tells the service how a vehicle's sensors are mounted; ``draft-rig`` writes such a description."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from apexcal.client import Client
from apexcal.commands.named import assignments, check_id, pick
from apexcal.commands.options import ForceOption, TargetOption
from apexcal.commands.session import Reply, Session
from apexcal.commands.stated_files import read_text
from apexcal.commands.terminal import check_target, note, usage, write_content
from apexcal.documents.fleets import FleetOut, VehicleOut
from apexcal.rigs import read_rig

_CAMERA = re.compile(r"([^=]+)=([^=]+)=(\d+)x(\d+)")
New = TypeVar("New", FleetOut, VehicleOut)


def rig(
    session: Session,
    description: Annotated[
        Path | None, typer.Argument(help="JSON file of the rig: docs/rigs.md.", exists=True)
    ] = None,
    fleet: Annotated[
        str, typer.Option(help="Fleet, by name; a new name makes one. Needed where there are several.")
    ] = "",
    vehicle: Annotated[str, typer.Option(help="Vehicle, by name; a new name makes one.")] = "Vehicle",
    correct: Annotated[str, typer.Option(help="Id of a rig: its --images are corrected, and none is added.")] = "",
    images: Annotated[list[str] | None, typer.Option(help="CAMERA=raw or =rectified; CAMERA= forgets it.")] = None,
) -> Reply:
    """Add a rig to a vehicle: its LiDAR, its cameras and roughly where they are. Or correct what its images are."""
    if bool(description) == bool(correct) or bool(correct) != bool(images):
        raise typer.BadParameter("Give a description, or --correct with --images.")
    client = session.client
    if description is None:
        words = (text.partition("=") for text in images or ())
        kinds = {camera: {"kind": kind} if kind else None for camera, _, kind in words}
        corrected = client.vehicles.set_images(correct, kinds, version=client.vehicles.rig(correct).version)
        return Reply(corrected, f"The images of the rig {corrected.name!r} are corrected.")
    document = read_rig(description)
    in_fleet = _fleet(client, fleet)
    on_vehicle = _vehicle(client, in_fleet, vehicle) if in_fleet else None
    if in_fleet is None or on_vehicle is None:
        # Nothing is made for a rig that would be refused.
        client.vehicles.check_rig(document)
        in_fleet = in_fleet or _noted("fleet", client.fleets.create(fleet or "Fleet"))
        on_vehicle = _noted("vehicle", client.vehicles.create(in_fleet.id, vehicle))
    added = client.vehicles.create_rig(on_vehicle.id, document)
    where = f"{on_vehicle.name} in the fleet {in_fleet.name}"
    return Reply(added, f"The rig {added.name!r} of {where} is {added.id}.")


def draft_rig(
    session: Session,
    lidar: Annotated[str, typer.Option(help="The LiDAR's link.", show_default=False)],
    camera: Annotated[
        list[str],
        typer.Option(
            help="NAME=LINK=WIDTHxHEIGHT of a camera; LINK is its optical frame. May be given several times.",
            show_default=False,
        ),
    ],
    urdf: Annotated[Path | None, typer.Option(help="The vehicle's URDF file.", exists=True)] = None,
    recording: Annotated[str, typer.Option(help="Id of a recording, for its /tf_static.")] = "",
    joint: Annotated[
        list[str] | None,
        typer.Option(help="NAME=JOINT: the joint (or its child link) that a camera's results are given for."),
    ] = None,
    vehicle_link: Annotated[str, typer.Option(help="The vehicle's link; otherwise the root above the LiDAR.")] = "",
    name: Annotated[str, typer.Option(help="The rig's name.")] = "roof",
    output: TargetOption = None,
    force: ForceOption = False,
) -> None:
    """Write a rig's description for `apexcal rig`: mounts, frames, and the joints to solve for.

    Without --output it goes to the terminal.
    """
    if (urdf is None) == (not recording):
        usage("draft-rig needs either --urdf or --recording")
    if output:
        check_target(output, force)
    joints = assignments(joint, "--joint", "NAME=JOINT")
    request: dict[str, Any] = {
        "name": name,
        "lidar_link": lidar,
        "vehicle_link": vehicle_link or None,
        "cameras": [_camera(text, joints) for text in camera],
    }
    if joints:
        usage(f"--joint names {next(iter(joints))!r}, which is no camera", "Name cameras as --camera does")
    imports = session.client.imports
    if urdf is not None:
        draft = imports.draft_rig(read_text(urdf), **request)
    else:
        draft = imports.draft_rig_of_recording(check_id(recording, "recording"), **request)
    for sentence in draft.notes:
        note(sentence)
    text = json.dumps(draft.rig.model_dump(mode="json", exclude_none=True), indent=2, ensure_ascii=False)
    if output is None:
        print(text)
        return
    write_content(output, text + "\n")
    note(f"Wrote {output}. Add it with `apexcal rig {output}`.")


def _camera(text: str, joints: dict[str, str]) -> dict[str, Any]:
    match = _CAMERA.fullmatch(text)
    if match is None:
        usage(f"--camera {text} is not understood", "Write it as --camera front=camera_front_optical=1920x1200")
    name, link, width, height = match.groups()
    return {"name": name, "link": link, "image_size": [int(width), int(height)], "joint": joints.pop(name, None)}


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
