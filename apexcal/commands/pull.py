"""``apexcal pull``: what a vehicle is given, kept in a file. For start-up scripts.

Exit codes: 0 the file is what the vehicle is given now, replaced or not; 1 the service refused, or the file could
not be written; 2 wrong usage; 3 no answer now, or one that says to come again: try again; 5 it was withdrawn or
deleted; 6 it is of other sensors than the mounted ones; 7 what answered is no calibration of this vehicle. After 1,
3, 5, 6 and 7 the file is still the last that was pulled. 4: as these, but no file was ever pulled whole.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, Final
from uuid import UUID

import typer

from apexcal.archives import read_archive
from apexcal.client import ApiError, Client
from apexcal.commands.named import find_vehicle, is_id
from apexcal.commands.options import AliasOption, CamerasOption, FleetOption, OutputOption, VehicleOption
from apexcal.commands.session import Session
from apexcal.commands.terminal import complain, note, usage, write_content
from apexcal.documents.publications import CURRENT
from apexcal.errors import ForeignAnswerError
from apexcal.kept_file import KeptFile, replace_folder
from apexcal.pull_alone import FAILED, FOREIGN, NOTHING_KEPT, REFUSED, UNREACHABLE

_PROGRAM: Final = ("archives", "kept_file", "pull_alone")
"""Modules of the program that `--program` writes. Each needs Python 3.8 and imports only those before it."""


def pull(
    session: Session,
    output: OutputOption,
    vehicle: VehicleOption = "",
    fleet: FleetOption = "",
    sensor: Annotated[
        str, typer.Option(help="The vehicle, by the serial number of its LiDAR or of a camera, instead of --vehicle.")
    ] = "",
    camera: CamerasOption = None,
    format: Annotated[str, typer.Option("--format", help="json, or a format of `apexcal export`.")] = "json",
    as_of: Annotated[str, typer.Option(help="What it was given at this moment: 2026-03-01T12:00:00Z.")] = "",
    alias: AliasOption = CURRENT,
    serial: Annotated[
        list[str] | None,
        typer.Option(help="NAME=SERIAL of a mounted sensor; NAME is a camera or lidar. May be repeated."),
    ] = None,
    unpack: Annotated[
        bool, typer.Option("--unpack", help="Keep a folder of the files of --format: OUTPUT is a link to it.")
    ] = False,
    program: Annotated[
        bool, typer.Option("--program", help="Write the program itself to OUTPUT, one file for Python 3.8 and newer.")
    ] = False,
    timeout: Annotated[float, typer.Option(help="Seconds to wait for each answer.", min=0.1, max=600.0)] = 10.0,
) -> None:
    """Keep what a vehicle is given now (all its cameras) in a file. It is replaced whole, or not at all.

    Exit codes: 0 the file is what the vehicle is given now; 1 the service refused, or the file cannot be written;
    2 wrong usage; 3 no answer now: try again; 5 the calibration was withdrawn or deleted; 6 it is of other sensors
    than the mounted ones; 7 what answered is no calibration of this vehicle. After 1, 3, 5, 6 and 7 the last good
    file stays. 4: as these, but there is no good file.
    """
    if program:
        write_content(output, program_source())
        note(f"{output} is the program: python3 {output.name} --help")
        return
    # A link to a file stays, and what it leads to is replaced. A link to a folder is replaced itself.
    output = output.parent.resolve() / output.name if unpack else output.resolve()
    fits = output.is_symlink() if unpack else output.is_file()
    if (output.exists() and not fits) or not output.parent.is_dir():
        usage(f"{output} is no place for a {'link' if unpack else 'file'}", "Name a new one in a folder that exists")
    pulled = KeptFile(output.with_name(f".{output.name}.zip") if unpack else output)
    try:
        with session.saying_errors(), session.connect(timeout) as client, _ended():
            query: dict[str, Any] = {"camera": camera or None, "as_of": as_of or None, "serial": serial or None}
            query |= {} if alias == CURRENT else {"alias": alias}
            vehicle_id = None
            if (sensor or vehicle) and not is_id(vehicle):
                query |= {"vehicle": vehicle or None, "fleet": fleet or None, "sensor": sensor or None}
            else:
                vehicle_id = UUID(vehicle) if vehicle else find_vehicle(client, fleet, vehicle).id
            query_key = json.dumps([client.base_url, str(vehicle_id), format, query])
            changed = _keep(client, pulled, query_key, {"vehicle_id": vehicle_id, "format": format, **query}, unpack)
            if unpack:
                replace_folder(output, read_archive(pulled.path.read_bytes()))
    except typer.Exit as left:
        if left.exit_code in (FAILED, UNREACHABLE, FOREIGN, *REFUSED.values()):
            _say_what_is_kept(pulled)
        raise
    note(f"{output} {'was replaced' if changed else 'has not changed'}.")


def program_source() -> str:
    """Return `apexcal pull` as the source of one program of the standard library alone."""
    folder = Path(__file__).parents[1]
    sources = [(folder / f"{name}.py").read_text(encoding="utf-8") for name in _PROGRAM]
    modules = [re.sub(r"^from (?:__future__|apexcal\.\w+) import .*\n", "", text, flags=re.M) for text in sources]
    return "\n\n".join(["#!/usr/bin/env python3\nfrom __future__ import annotations", *modules])


@contextmanager
def _ended() -> Iterator[None]:
    """Ends the command with the exit code of what goes wrong inside the block, if it has one of its own."""
    try:
        yield
    except ApiError as error:
        is_foreign = error.code == "not_a_problem_document"
        code = UNREACHABLE if error.is_temporary else FOREIGN if is_foreign else REFUSED.get(error.code)
        if code is None:
            raise
        complain(f"{str(error).rstrip('.')} ({error.code})", error.hint, code=code)
    except ForeignAnswerError as error:
        complain(str(error), error.hint, code=FOREIGN)
    except OSError as error:
        complain(f"cannot write {error.filename or 'the file'}: {(error.strerror or str(error)).lower()}")


def _keep(client: Client, pulled: KeptFile, query_key: str, request: dict[str, Any], unpack: bool) -> bool:
    """Whether the kept file was replaced, because the service has another content than it."""
    new = client.calibrations.vehicle_if_changed(etag=pulled.etag(query_key), **request)
    if new is None:
        return False
    content, etag = new
    if unpack:
        if not content.startswith(b"PK"):
            usage("--unpack is for a format of several files", "Leave it out for this format")
        try:
            read_archive(content)
        except ValueError as error:
            raise ForeignAnswerError(client.base_url, f"answered what {error}") from None
    pulled.replace(content, etag, query_key)
    return True


def _say_what_is_kept(pulled: KeptFile) -> None:
    if not pulled.is_whole():
        complain(f"there is no {pulled.path} that was pulled before", code=NOTHING_KEPT)
    note(f"{pulled.path} is as it was pulled last.")
