"""``apexcal alias``: shows and moves a camera's aliases, such as ``canary``."""

from __future__ import annotations

from itertools import islice
from typing import Annotated

import typer

from apexcal.client import Client, ClientError
from apexcal.commands.common import DataOption, JsonOption, TokenOption, UrlOption, say, usage
from apexcal.commands.connect import check_id, connected
from apexcal.commands.publications import (
    CameraOption,
    FleetOption,
    OverrideOption,
    VehicleOption,
    find_vehicle_camera,
    lines,
    saying_objections,
)
from apexcal.documents.fleets import VehicleOut
from apexcal.documents.publications import PublicationView
from apexcal.embedded.folder import DEFAULT


def alias(
    name: Annotated[str, typer.Argument(help="The alias; without it all are listed.")] = "",
    result: Annotated[str, typer.Option(help="Let it lead to this result.")] = "",
    remove: Annotated[bool, typer.Option("--remove", help="Let it lead nowhere.")] = False,
    reason: Annotated[str, typer.Option(help="Why it moves; kept with the move.")] = "",
    override: OverrideOption = False,
    vehicle: VehicleOption = "",
    camera: CameraOption = "",
    fleet: FleetOption = "",
    limit: Annotated[int, typer.Option(help="How many moves at most, newest first.", min=1)] = 20,
    url: UrlOption = "",
    token: TokenOption = "",
    data: DataOption = DEFAULT,
    as_json: JsonOption = False,
) -> None:
    """List a camera's aliases, or the moves of one. With --result or --remove, move it.

    A vehicle that pulls with --alias NAME gets what the alias leads to. `current` moves with `apexcal publish`.
    """
    moves = bool(result) or remove
    if moves and (not name or not reason.strip()):
        usage("a move takes the alias and a reason", "Say why with --reason; it is kept with the move")
    if result and remove:
        usage("--result and --remove exclude each other")
    with connected(url, token, data) as client, saying_objections():
        on, of = find_vehicle_camera(client, fleet, vehicle, camera)
        if moves:
            if remove:
                made = _removed(client, on, of, name, reason.strip())
            else:
                _check_camera(client, on, of, check_id(result, "result"))
                made = client.calibrations.publish(result, reason.strip(), override=override, alias=name)
            say(made, as_json, _text(made))
            return
        listed = _listed(client, on, of, name, limit)
    say(listed, as_json, "\n".join(map(_text, listed)) or f"{of} of {on.name} has no such alias yet.")


def _listed(client: Client, on: VehicleOut, of: str, name: str, limit: int) -> list[PublicationView]:
    if name:
        return list(islice(client.calibrations.publications(on.id, of, name), limit))
    return client.calibrations.aliases(on.id, of)


def _check_camera(client: Client, on: VehicleOut, of: str, result_id: str) -> None:
    result = client.calibrations.result(result_id)
    if (result.vehicle_id, result.camera) != (on.id, of):
        raise ClientError("this result is of another camera or vehicle", f"Take one of {of} of {on.name}.")


def _removed(client: Client, on: VehicleOut, of: str, name: str, reason: str) -> PublicationView:
    newest = next(client.calibrations.publications(on.id, of, name), None)
    if newest is None:
        raise ClientError(f"{of} of {on.name} has no alias {name}", "`apexcal alias` lists those that it has.")
    return client.calibrations.withdraw(newest.id, reason)


def _text(publication: PublicationView) -> str:
    return "\n".join([f"{publication.alias} of {publication.camera}", *(f"  {line}" for line in lines(publication))])
