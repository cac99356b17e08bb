"""``apexcal invite``: a one-time sign-in link with a role."""

from __future__ import annotations

from typing import Annotated

import typer

from apexcal.commands.common import DataOption, JsonOption, TokenOption, UrlOption, say
from apexcal.commands.connect import connected, find_fleet
from apexcal.documents.roles import Role
from apexcal.embedded.folder import DEFAULT


def invite(
    name: Annotated[str, typer.Argument(help="The person's name, as others will see it.")],
    role: Annotated[Role, typer.Option(help="What the person may do.")] = "annotator",
    fleet: Annotated[str, typer.Option(help="Fleet, by name or id; needed where there are several.")] = "",
    url: UrlOption = "",
    token: TokenOption = "",
    data: DataOption = DEFAULT,
    as_json: JsonOption = False,
) -> None:
    """Make a link that signs one person in, once. Send it to that person only."""
    with connected(url, token, data) as client:
        chosen = find_fleet(client, fleet)
        invitation = client.fleets.invite(chosen.id, name, role)
    until = invitation.expires_at.astimezone()
    say(
        invitation,
        as_json,
        f"{name} becomes {role} of {chosen.name} with this link, "
        f"which works once until {until:%Y-%m-%d %H:%M %Z}:\n{invitation.link}",
    )
