"""``apexcal export``: a calibration as a file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from apexcal.client import ApiError, Client
from apexcal.commands.common import DataOption, TokenOption, UrlOption, check_target, console, usage, write_target
from apexcal.commands.connect import check_id, connected, find_camera, find_vehicle
from apexcal.embedded.folder import DEFAULT
from apexcal.transport import Document


def export(
    vehicle: Annotated[str, typer.Option(help="Vehicle, by name or id; needed where there are several.")] = "",
    camera: Annotated[str, typer.Option(help="Camera; needed where the vehicle has several.")] = "",
    fleet: Annotated[str, typer.Option(help="Fleet, by name or id.")] = "",
    result: Annotated[str, typer.Option(help="Id of one result, instead of the current calibration.")] = "",
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="File to write; otherwise the terminal.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace the file.")] = False,
    url: UrlOption = "",
    token: TokenOption = "",
    data: DataOption = DEFAULT,
) -> None:
    """Write a camera's current calibration (intrinsics and transform, frames named), or a whole result, as JSON."""
    if result and (vehicle or camera):
        usage("a result belongs to one camera already", "Leave out --vehicle and --camera, or leave out --result")
    if output:
        check_target(output, force)
    with connected(url, token, data) as client:
        if result:
            document = client.calibrations.result(check_id(result, "result"))
        else:
            on = find_vehicle(client, fleet, vehicle)
            rigs = list(client.vehicles.rigs(on["id"]))
            cameras = {each["name"]: each for rig in rigs for each in rig["cameras"]}
            document = _current(client, on, find_camera({"cameras": list(cameras.values())}, camera))
    text = json.dumps(document, indent=2, ensure_ascii=False)
    if output is None:
        print(text)
        return
    write_target(output, text + "\n")
    console(errors=True).print(f"Wrote {output}.", soft_wrap=True)


def _current(client: Client, vehicle: Document, camera: str) -> Document:
    """The current calibration; where there is none, the refusal names the command that makes one."""
    try:
        return client.calibrations.current(vehicle["id"], camera)
    except ApiError as error:
        if error.code == "no_calibration_yet":
            error.hint = (
                "Make one with `apexcal calibrate --detection DETECTION`; a result that was not published by itself "
                "is published on the calibration's page, or written with --result."
            )
        raise
