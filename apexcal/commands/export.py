"""``apexcal export``: a calibration as a file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from apexcal.client import ApiError, Client
from apexcal.commands.common import (
    DataOption,
    TokenOption,
    UrlOption,
    as_document,
    check_target,
    console,
    usage,
    write_target,
)
from apexcal.commands.connect import check_id, connected
from apexcal.commands.publications import CameraOption, FleetOption, VehicleOption, find_vehicle_camera
from apexcal.documents.fleets import VehicleOut
from apexcal.documents.results import CurrentCalibration
from apexcal.embedded.folder import DEFAULT


def export(
    vehicle: VehicleOption = "",
    camera: CameraOption = "",
    fleet: FleetOption = "",
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
            document = _current(client, *find_vehicle_camera(client, fleet, vehicle, camera))
    text = json.dumps(as_document(document), indent=2, ensure_ascii=False)
    if output is None:
        print(text)
        return
    write_target(output, text + "\n")
    console(errors=True).print(f"Wrote {output}.", soft_wrap=True)


def _current(client: Client, vehicle: VehicleOut, camera: str) -> CurrentCalibration:
    """The current calibration; where there is none, the refusal names the command that makes one."""
    try:
        return client.calibrations.current(vehicle.id, camera)
    except ApiError as error:
        if error.code == "no_calibration_yet":
            error.hint = (
                "Make one with `apexcal calibrate --detection DETECTION`; a result that was not published by itself "
                "is published with `apexcal publish` or on the calibration's page, or written with --result."
            )
        raise
