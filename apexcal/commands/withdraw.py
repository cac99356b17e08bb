"""``apexcal withdraw``: takes back what a camera was given."""

from __future__ import annotations

from typing import Annotated

import typer

from apexcal.client import ClientError
from apexcal.commands.common import DataOption, JsonOption, TokenOption, UrlOption, say, usage
from apexcal.commands.connect import connected
from apexcal.commands.publications import CameraOption, FleetOption, VehicleOption, find_vehicle_camera
from apexcal.embedded.folder import DEFAULT


def withdraw(
    reason: Annotated[str, typer.Option(help="Why it must not be used; cars are told.", show_default=False)],
    vehicle: VehicleOption = "",
    camera: CameraOption = "",
    fleet: FleetOption = "",
    url: UrlOption = "",
    token: TokenOption = "",
    data: DataOption = DEFAULT,
    as_json: JsonOption = False,
) -> None:
    """Take back a camera's current calibration. The camera is given nothing until something is published.

    `apexcal rollback` or `apexcal publish` publishes an older result again.
    """
    if not reason.strip():
        usage("the reason is empty", "Say why with --reason; cars are told")
    with connected(url, token, data) as client:
        on, of = find_vehicle_camera(client, fleet, vehicle, camera)
        newest = next(client.calibrations.publications(on.id, of), None)
        if newest is None or newest.result_id is None:
            raise ClientError(f"{of} of {on.name} is given nothing", "There is nothing to withdraw.")
        made = client.calibrations.withdraw(newest.id, reason.strip())
    say(
        made,
        as_json,
        f"{of} of {on.name} is given nothing now: {made.model} of {made.published_at.isoformat()} is withdrawn.",
    )
