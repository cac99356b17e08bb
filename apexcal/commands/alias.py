"""``apexcal alias``: shows and moves a camera's aliases, such as ``canary``."""

from __future__ import annotations

from itertools import islice
from typing import Annotated

import typer

from apexcal.client import Client
from apexcal.commands.common import DataOption, JsonOption, TokenOption, UrlOption, say, usage
from apexcal.commands.connect import check_id, connected
from apexcal.commands.publications import (
    CameraOption,
    FleetOption,
    OverrideOption,
    VehicleOption,
    find_vehicle_camera,
    saying_objections,
)
from apexcal.documents.fleets import VehicleOut
from apexcal.documents.publications import AliasMoveView
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
            to = check_id(result, "result") if result else None
            made = client.calibrations.move_alias(on.id, of, name, to, reason.strip(), override=override)
            say(made, as_json, _line(made))
            return
        found = _found(client, on, of, name, limit)
    say(found, as_json, "\n".join(map(_line, found)) or f"{of} of {on.name} has no such alias yet.")


def _found(client: Client, on: VehicleOut, of: str, name: str, limit: int) -> list[AliasMoveView]:
    if name:
        return list(islice(client.calibrations.alias_moves(on.id, of, name), limit))
    return client.calibrations.aliases(on.id, of)


def _line(move: AliasMoveView) -> str:
    by = f" by {move.moved_by}" if move.moved_by else ""
    to = f"{move.model}, result {move.result_id}" if move.result_id else "nowhere"
    against = [f"\n  Against: {one}" for one in (move.override.objections if move.override else [])]
    first = f"{move.alias} of {move.camera} leads to {to}, {move.moved_at.isoformat()}{by}: {move.reason}"
    return "".join([first, *against])
