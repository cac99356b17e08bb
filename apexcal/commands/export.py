"""``apexcal export``: a calibration as JSON, or as files for other programs."""

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
from apexcal.commands.exported_files import write_exported
from apexcal.commands.publications import CameraOption, FleetOption, VehicleOption, find_vehicle_camera
from apexcal.documents.fleets import VehicleOut
from apexcal.documents.publications import CURRENT
from apexcal.documents.summaries import CurrentCalibration
from apexcal.embedded.folder import DEFAULT
from apexcal.resources.exports import Exported

FormatOption = Annotated[
    str,
    typer.Option(
        "--format",
        help="json, or one of camera_info, ros2, urdf, autoware, kitti, kalibr, opencv, nuscenes, openlabel, vcd.",
    ),
]


def export(
    vehicle: VehicleOption = "",
    camera: CameraOption = "",
    fleet: FleetOption = "",
    result: Annotated[str, typer.Option(help="Id of one result, instead of the current calibration.")] = "",
    format: FormatOption = "json",
    alias: Annotated[str, typer.Option(help="The alias to follow, such as canary.")] = CURRENT,
    urdf: Annotated[
        Path | None, typer.Option(help="The vehicle's own URDF, or Autoware's YAML file, to change one pose in.")
    ] = None,
    joint: Annotated[str, typer.Option(help="The joint of --urdf, or the camera's entry in Autoware's file.")] = "",
    camera_link: Annotated[str, typer.Option(help="The camera's optical link in --urdf, if not the frame.")] = "",
    lidar_link: Annotated[str, typer.Option(help="The LiDAR's link in --urdf, if not the frame.")] = "",
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="File to write, or folder for several; otherwise the terminal."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace the file.")] = False,
    url: UrlOption = "",
    token: TokenOption = "",
    data: DataOption = DEFAULT,
) -> None:
    """Write a camera's current calibration (intrinsics and transform, frames named), or a result.

    With --urdf: that file with the origin of --joint as it was calibrated, and every other byte as it is.
    """
    if result and (vehicle or camera):
        usage("a result belongs to one camera already", "Leave out --vehicle and --camera, or leave out --result")
    if alias != CURRENT and (result or urdf is not None):
        usage("--alias is for a camera's calibration as JSON or in a format")
    if (urdf is None) != (not joint):
        usage("--urdf and --joint belong together")
    if output and format == "json":
        check_target(output, force)
    with connected(url, token, data) as client:
        if urdf is not None or format != "json":
            of = check_id(result, "result") if result else find_vehicle_camera(client, fleet, vehicle, camera)
            links = {"camera_link": camera_link, "lidar_link": lidar_link}
            made = _exported(client, of, format, alias) if urdf is None else _patched(client, of, urdf, joint, links)
            write_exported(made, output, force)
            return
        if result:
            document = client.calibrations.result(check_id(result, "result"))
        else:
            document = _current(client, *find_vehicle_camera(client, fleet, vehicle, camera), alias)
    text = json.dumps(as_document(document), indent=2, ensure_ascii=False)
    if output is None:
        print(text)
        return
    write_target(output, text + "\n")
    console(errors=True).print(f"Wrote {output}.", soft_wrap=True)


def _exported(client: Client, of: str | tuple[VehicleOut, str], format: str, alias: str) -> Exported:
    if isinstance(of, str):
        return client.exports.result(of, format)
    return client.exports.current(of[0].id, of[1], format, alias)


def _patched(
    client: Client, of: str | tuple[VehicleOut, str], urdf: Path, joint: str, links: dict[str, str]
) -> Exported:
    # Read as bytes: the ends of lines stay as they are.
    text, given = urdf.read_bytes().decode(), {name: link for name, link in links.items() if link}
    if isinstance(of, str):
        return client.exports.urdf_of_result(of, text, joint, **given)
    return client.exports.urdf(of[0].id, of[1], text, joint, **given)


def _current(client: Client, vehicle: VehicleOut, camera: str, alias: str) -> CurrentCalibration:
    """The current calibration; where there is none, the refusal names the command that makes one."""
    try:
        return client.calibrations.current(vehicle.id, camera, alias)
    except ApiError as error:
        if error.code == "no_calibration_yet":
            error.hint = (
                "Make one with `apexcal calibrate --detection DETECTION`; a result that was not published by itself "
                "is published with `apexcal publish` or on the calibration's page, or written with --result."
            )
        raise
