"""``apexcal publish``: makes a result its camera's current calibration."""

from __future__ import annotations

from typing import Annotated

import typer

from apexcal.commands.common import DataOption, JsonOption, TokenOption, UrlOption, say, usage
from apexcal.commands.connect import check_id, connected
from apexcal.commands.publications import OverrideOption, given, saying_checks
from apexcal.embedded.folder import DEFAULT


def publish(
    result: Annotated[str, typer.Argument(help="Id of a result; `apexcal calibrate --json` prints them.")],
    reason: Annotated[str, typer.Option(help="Why it is published; kept with it.")] = "",
    override: OverrideOption = False,
    url: UrlOption = "",
    token: TokenOption = "",
    data: DataOption = DEFAULT,
    as_json: JsonOption = False,
) -> None:
    """Make a result its camera's current calibration. Against a check of `stop` this takes --override."""
    check_id(result, "result")
    if override and not reason.strip():
        usage("--override needs a reason", "Say why with --reason; it is kept with the publication")
    with connected(url, token, data) as client, saying_checks():
        made = client.calibrations.publish(result, reason.strip() or None, override=override)
        vehicle = client.vehicles.get(made.vehicle_id).name
    say(made, as_json, given(made, vehicle))
