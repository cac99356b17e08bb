"""``apexcal compare``: a result beside another one, or beside a mount and lens that another program states."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from apexcal.commands.common import DataOption, JsonOption, TokenOption, UrlOption, say, usage
from apexcal.commands.connect import check_id, connected
from apexcal.commands.publications import CameraOption, FleetOption, VehicleOption, find_vehicle_camera
from apexcal.commands.stated_files import read_texts
from apexcal.documents.comparisons import ResultComparison
from apexcal.documents.imports import StatedComparison
from apexcal.embedded.folder import DEFAULT


def compare(
    files: Annotated[
        list[Path] | None, typer.Argument(help="Calibration file of OpenCV, or all of KITTI's.", exists=True)
    ] = None,
    other: Annotated[str, typer.Option("--with", help="Id of another result, instead of files.")] = "",
    of: Annotated[str, typer.Option(help="The camera's name in the files, if they hold several.")] = "",
    result: Annotated[str, typer.Option(help="Id of one result, instead of the current calibration.")] = "",
    image_size: Annotated[
        tuple[int, int] | None, typer.Option(help="Width and height, for files that say none.")
    ] = None,
    vehicle: VehicleOption = "",
    camera: CameraOption = "",
    fleet: FleetOption = "",
    url: UrlOption = "",
    token: TokenOption = "",
    data: DataOption = DEFAULT,
    as_json: JsonOption = False,
) -> None:
    """Say how far a camera's calibration is from another result, or from what a file of another program states."""
    if bool(files) == bool(other):
        usage("a result is compared either with files or with another result", "Give files, or --with RESULT")
    if result and (vehicle or camera):
        usage("a result belongs to one camera already", "Leave out --vehicle and --camera, or leave out --result")
    with connected(url, token, data) as client:
        if result:
            result_id = check_id(result, "result")
        else:
            on, name = find_vehicle_camera(client, fleet, vehicle, camera)
            result_id = str(client.calibrations.current(on.id, name).result_id)
        if other:
            both = client.calibrations.compare(result_id, check_id(other, "result"))
            say(both, as_json, "\n".join(_lines_of_both(both)))
            return
        texts = read_texts(files or [])
        found = client.imports.compare(result_id, files=texts, camera=of or None, image_size=image_size)
    say(found, as_json, "\n".join(_lines(found)))


def _lines_of_both(found: ResultComparison) -> list[str]:
    lines = [found.sentence]
    if found.field_px is not None:
        sigmas = "" if found.field_sigmas is None else f", {found.field_sigmas:.1f} standard deviations"
        lines.append(f"Points 5 and 20 m away lie {found.field_px:.2f} px apart in the image (RMS{sigmas}).")
    for one in found.parameters:
        sigmas = "" if one.sigmas is None else f"  {one.sigmas:.1f} standard deviations"
        lines.append(f"  {one.name:11} {one.difference:+10.4g} {one.unit:3}{sigmas}")
    return lines


def _lines(found: StatedComparison) -> list[str]:
    lines: list[str] = []
    if found.rotation_deg is not None and found.translation_mm is not None:
        sigmas = "" if found.sigmas is None else f", {found.sigmas:.1f} standard deviations of the result"
        lines.append(
            f"T_camera_lidar differs by {found.rotation_deg:.3f} degrees and {found.translation_mm:.1f} mm{sigmas}."
        )
    if found.lens is not None:
        lens = found.lens
        lines.append(
            f"The result's lens minus the stated one: f_x {lens.f_x:+.2f}, f_y {lens.f_y:+.2f}, c_x {lens.c_x:+.2f}, "
            f"c_y {lens.c_y:+.2f} px."
        )
    return [*lines, *found.hints] or ["The files state neither a lens nor a mount of this camera."]
