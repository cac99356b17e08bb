"""``apexcal export``: a calibration as JSON, or as files for other programs: one, the terminal, or a folder."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from apexcal.archives import read_archive
from apexcal.client import ApiError
from apexcal.commands.named import find_result, find_vehicle_camera
from apexcal.commands.options import AliasOption, CameraOption, FleetOption, ForceOption, TargetOption, VehicleOption
from apexcal.commands.session import Session, as_document
from apexcal.commands.terminal import check_target, complain, note, usage, write_content
from apexcal.documents.publications import CURRENT
from apexcal.resources.exports import ExportedFile

FormatOption = Annotated[
    str,
    typer.Option(
        "--format",
        help="json, or one of camera_info, ros2, urdf, autoware, kitti, kitti_object, kalibr, opencv, fast_livo2, "
        "direct_visual, nuscenes, openlabel, vcd.",
    ),
]


def export(
    session: Session,
    vehicle: VehicleOption = "",
    camera: CameraOption = "",
    fleet: FleetOption = "",
    result: str = "",
    format: FormatOption = "json",
    alias: AliasOption = CURRENT,
    urdf: Path | None = None,
    joint: str = "",
    camera_link: str = "",
    lidar_link: str = "",
    output: TargetOption = None,
    force: ForceOption = False,
) -> None:
    """Write a camera's current calibration (intrinsics and transform, frames named), or a result.

    With --urdf: that file with the origin of --joint as it was calibrated, and every other byte as it is.
    Without --output it goes to the terminal; --output is a folder for a format of several files.

    Args:
        result: Id of one result, instead of the current calibration.
        urdf: The vehicle's own URDF, or Autoware's YAML file, to change one pose in.
        joint: The joint of --urdf, or the camera's entry in Autoware's file.
        camera_link: The camera's optical link in --urdf, if not the frame.
        lidar_link: The LiDAR's link in --urdf, if not the frame.
    """
    if result and (vehicle or camera):
        usage("a result belongs to one camera already", "Leave out --vehicle and --camera, or leave out --result")
    if alias != CURRENT and (result or urdf is not None):
        usage("--alias is for a camera's calibration as JSON or in a format")
    if (urdf is None) != (not joint):
        usage("--urdf and --joint belong together")
    if output and format == "json":
        check_target(output, force)
    client = session.client
    result_id = find_result(session.client, result) if result else ""
    vehicle_id, name = "", ""
    if not result_id:
        on, name = find_vehicle_camera(client, fleet, vehicle, camera)
        vehicle_id = str(on.id)
    if urdf is not None:
        # Read as bytes: the ends of lines stay as they are.
        text = urdf.read_bytes().decode()
        links = {word: link for word, link in (("camera_link", camera_link), ("lidar_link", lidar_link)) if link}
        if result_id:
            exported = client.exports.urdf_of_result(result_id, text, joint, **links)
        else:
            exported = client.exports.urdf(vehicle_id, name, text, joint, **links)
    elif format != "json" and result_id:
        exported = client.exports.result(result_id, format)
    elif format != "json":
        exported = client.exports.current(vehicle_id, name, format, alias)
    else:
        calibrations = client.calibrations
        with _naming_the_command():
            document = calibrations.result(result_id) if result_id else calibrations.current(vehicle_id, name, alias)
        content = json.dumps(as_document(document), indent=2, ensure_ascii=False) + "\n"
        exported = ExportedFile("json", content.encode())
    write_exported(exported, output, force)


@contextmanager
def _naming_the_command() -> Iterator[None]:
    """Let the refusal name the command that makes a calibration, if there is none yet."""
    try:
        yield
    except ApiError as error:
        if error.code == "no_calibration_yet":
            error.hint = (
                "Make one with `apexcal calibrate --detection DETECTION`; a result that was not published by itself "
                "is published with `apexcal publish` or on the calibration's page, or written with --result."
            )
        raise


def write_exported(exported: ExportedFile, output: Path | None, force: bool) -> None:
    """Write what the service made. Several files go below ``output``, or into one where that ends with ``.zip``."""
    for sentence in exported.notes:
        note(sentence)
    if exported.name.endswith(".zip") and (output is None or output.suffix != ".zip"):
        _write_below(exported.content, output, force)
    elif output is None:
        print(exported.content.decode(), end="")
    else:
        check_target(output, force)
        write_content(output, exported.content)
        note(f"Wrote {output}.")


def _write_below(archive: bytes, folder: Path | None, force: bool) -> None:
    if folder is None:
        usage("this format is several files", "Name a folder for them with --output, or a file that ends with .zip")
    try:
        files = read_archive(archive)
    except ValueError as error:
        complain(f"what the service answered {error}")
    if folder.exists() and not folder.is_dir():
        usage(f"{folder} is a file", "Name a folder")
    for name in files:
        if (folder / name).exists() and not force:
            usage(f"{folder / name} exists already", "Name another folder, or say --force")
    for name, content in files.items():
        write_content(folder / name, content)
    note(f"Wrote {', '.join(files)} below {folder}.")
