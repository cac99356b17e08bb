"""``apexcal token``: a token for a program, shown once."""

from __future__ import annotations

from typing import Annotated

import typer

from apexcal.commands.common import DataOption, JsonOption, TokenOption, UrlOption, say
from apexcal.commands.connect import connected, find_fleet
from apexcal.documents.roles import Role
from apexcal.embedded.folder import DEFAULT


def token(
    name: Annotated[str, typer.Argument(help="What the token is for, as the list of tokens will show it.")],
    role: Annotated[Role, typer.Option(help="What its bearer may do.")] = "viewer",
    fleet: Annotated[str, typer.Option(help="Fleet, by name or id; needed where there are several.")] = "",
    days: Annotated[int, typer.Option(help="Days that it is valid; 0 for no end.", min=0, max=3650)] = 0,
    link: Annotated[str, typer.Option(help="A sign-in link of whoever makes the token; it works once.")] = "",
    url: UrlOption = "",
    token: TokenOption = "",
    data: DataOption = DEFAULT,
    as_json: JsonOption = False,
) -> None:
    """Make an API token of one fleet, for programs and other machines. It is shown this once.

    A token cannot make tokens: away from the service's machine, give a sign-in link with --link.
    """
    with connected(url, token, data, link) as client:
        chosen = find_fleet(client, fleet)
        made = client.fleets.create_token(chosen.id, name, role, expires_in_days=days or None)
    say(made, as_json, f"{name} is {role} of {chosen.name} with this token, shown only now:\n{made.token}")
