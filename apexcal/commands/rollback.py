"""``apexcal rollback``: restores a camera's previous calibration."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated
from uuid import UUID

import typer

from apexcal.client import ClientError
from apexcal.commands.common import DataOption, JsonOption, TokenOption, UrlOption, say, usage
from apexcal.commands.connect import connected
from apexcal.commands.publications import (
    CameraOption,
    FleetOption,
    OverrideOption,
    VehicleOption,
    find_vehicle_camera,
    given,
    saying_objections,
)
from apexcal.documents.publications import PublicationView
from apexcal.embedded.folder import DEFAULT


def rollback(
    reason: Annotated[str, typer.Option(help="Why it goes back; kept with the publication.", show_default=False)],
    vehicle: VehicleOption = "",
    camera: CameraOption = "",
    fleet: FleetOption = "",
    override: OverrideOption = False,
    url: UrlOption = "",
    token: TokenOption = "",
    data: DataOption = DEFAULT,
    as_json: JsonOption = False,
) -> None:
    """Restore the result that a camera had before the current one. Nothing is deleted.

    A second call goes back one further. `apexcal publications` lists all results, `apexcal publish` publishes any.
    """
    if not reason.strip():
        usage("the reason is empty", "Say why with --reason; it is kept with the publication")
    with connected(url, token, data) as client, saying_objections():
        on, of = find_vehicle_camera(client, fleet, vehicle, camera)
        before = _before(list(client.calibrations.publications(on.id, of)))
        if before is None:
            raise ClientError(
                f"{of} of {on.name} had no result before the current one",
                "`apexcal publications` lists what it was given.",
            )
        made = client.calibrations.publish(before, reason.strip(), override=override)
    say(made, as_json, given(made, on.name))


def _before(moves: list[PublicationView]) -> UUID | None:
    """The result given before the current one was first given, so going back twice goes further back.

    ``moves``: the newest first. Results that were withdrawn or deleted are skipped.
    """
    withdrawn = {before.led_to for after, before in pairwise(moves) if after.led_to is None}
    results = [move.led_to for move in moves if move.led_to is not None]
    first = max((index for index, result in enumerate(results) if result == results[0]), default=0)
    skipped = withdrawn | {move.led_to for move in moves if move.result_id is None}
    return next((result for result in results[first + 1 :] if result not in skipped), None)
