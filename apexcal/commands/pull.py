"""``apexcal pull``: what a vehicle is given, kept in a file. For start-up scripts.

Exit codes: 0 the file is what the vehicle is given now, replaced or not; 1 the service refused, or the file could
not be written; 2 wrong usage; 3 no answer; 5 it was withdrawn or deleted; 6 it is of other sensors than the mounted
ones. After 1, 3, 5 and 6 the file is still the last that was pulled. 4: as these, but no file was ever pulled whole.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from apexcal.cli import FAILED, UNREACHABLE
from apexcal.client import ApiError, Client
from apexcal.commands.common import DataOption, TokenOption, UrlOption, complain, console, usage
from apexcal.commands.connect import connected, find_vehicle, is_id
from apexcal.commands.publications import FleetOption, VehicleOption
from apexcal.documents.publications import CURRENT
from apexcal.embedded.folder import DEFAULT
from apexcal.kept_file import KeptFile

NOTHING_KEPT, WITHDRAWN, OTHER_SENSORS = 4, 5, 6
_REFUSED = {
    "calibration_withdrawn": WITHDRAWN,
    "calibration_deleted": WITHDRAWN,
    "calibration_does_not_apply": OTHER_SENSORS,
}


def pull(
    output: Annotated[Path, typer.Option("--output", "-o", help="The file to keep.")],
    vehicle: VehicleOption = "",
    fleet: FleetOption = "",
    sensor: Annotated[
        str, typer.Option(help="The vehicle, by the serial number of its LiDAR or of a camera, instead of --vehicle.")
    ] = "",
    camera: Annotated[list[str] | None, typer.Option(help="Only this camera; may be given several times.")] = None,
    format: Annotated[str, typer.Option("--format", help="json, or a format of `apexcal export`.")] = "json",
    as_of: Annotated[str, typer.Option(help="What it was given at this moment: 2026-03-01T12:00:00Z.")] = "",
    alias: Annotated[str, typer.Option(help="The alias to follow, such as canary.")] = CURRENT,
    serial: Annotated[
        list[str] | None,
        typer.Option(help="NAME=SERIAL of a mounted sensor; NAME is a camera or lidar. May be repeated."),
    ] = None,
    timeout: Annotated[float, typer.Option(help="Seconds to wait for each answer.", min=0.1, max=600.0)] = 10.0,
    url: UrlOption = "",
    token: TokenOption = "",
    data: DataOption = DEFAULT,
) -> None:
    """Keep what a vehicle is given now (all its cameras) in a file. It is replaced whole, or not at all.

    Exit codes: 0 the file is what the vehicle is given now; 1 the service refused, or the file cannot be written;
    2 wrong usage; 3 no answer; 5 the calibration was withdrawn or deleted; 6 it is of other sensors than the mounted
    ones. After 1, 3, 5 and 6 the last good file stays. 4: as these, but there is no good file.
    """
    output = output.resolve()  # a link stays, and what it leads to is replaced
    if (output.exists() and not output.is_file()) or not output.parent.is_dir():
        usage(f"{output} is no place for a file", "Name a file in a folder that exists")
    kept = KeptFile(output)
    try:
        with connected(url, token, data, timeout_s=timeout) as client:
            by_name = bool(sensor or vehicle) and not is_id(vehicle)
            named = {"vehicle": vehicle or None, "fleet": fleet or None, "sensor": sensor or None}
            vehicle_id = "" if by_name else str(find_vehicle(client, fleet, vehicle).id)
            query = {"camera": camera or None, "as_of": as_of or None, "format": format}
            query |= {"alias": alias, "serial": serial or None}
            query |= named if by_name else {}
            asked = json.dumps([client.base_url, vehicle_id, query])
            new = _new(client, vehicle_id, kept.etag(asked), query)
            if new is not None:
                _replace(kept, *new, asked)
    except typer.Exit as left:
        if left.exit_code in (FAILED, UNREACHABLE, *_REFUSED.values()):
            _say_what_is_kept(kept)
        raise
    state = "has not changed" if new is None else "was replaced"
    console(errors=True).print(f"{output} {state}.", soft_wrap=True)


def _new(client: Client, vehicle_id: str, etag: str | None, query: dict[str, Any]) -> tuple[bytes, str] | None:
    try:
        if not vehicle_id:
            return client.calibrations.found_if_changed(etag, **query)
        return client.calibrations.vehicle_if_changed(vehicle_id, etag, **query)
    except ApiError as error:
        if error.code not in _REFUSED:
            raise
        complain(f"{str(error).rstrip('.')} ({error.code})", error.hint, code=_REFUSED[error.code])


def _replace(kept: KeptFile, content: bytes, etag: str, asked: str) -> None:
    try:
        kept.replace(content, etag, asked)
    except OSError as error:
        complain(f"cannot write {kept.path}: {(error.strerror or str(error)).lower()}")


def _say_what_is_kept(kept: KeptFile) -> None:
    if not kept.is_whole():
        complain(f"there is no {kept.path} that was pulled before", code=NOTHING_KEPT)
    console(errors=True).print(f"{kept.path} is as it was pulled last.", soft_wrap=True)
