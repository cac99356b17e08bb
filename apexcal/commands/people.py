"""Who may use a service: ``invite``, ``token``."""

from __future__ import annotations

from typing import Annotated

import typer

from apexcal.client import Client
from apexcal.commands.named import find_fleet
from apexcal.commands.options import FleetOption
from apexcal.commands.session import Reply, Session
from apexcal.documents.roles import Role


def invite(session: Session, name: str, role: Role = "annotator", fleet: FleetOption = "") -> Reply:
    """Make a link that signs one person in, once. Send it to that person only.

    Args:
        name: The person's name, as others will see it.
        role: What the person may do.
    """
    of = find_fleet(session.client, fleet)
    invitation = session.client.fleets.invite(of.id, name, role)
    until = f"{invitation.expires_at.astimezone():%Y-%m-%d %H:%M %Z}"
    becomes = f"{name} becomes {role} of {of.name} with this link, which works once until {until}"
    return Reply(invitation, f"{becomes}:\n{invitation.link}")


def token(
    session: Session,
    name: str,
    role: Role = "viewer",
    fleet: FleetOption = "",
    days: Annotated[int, typer.Option(min=0, max=3650)] = 0,
    link: str = "",
) -> Reply:
    """Make an API token of one fleet, for programs and other machines. It is shown this once.

    A token cannot make tokens: away from the service's machine, give a sign-in link with --link.

    Args:
        name: What the token is for, as the list of tokens will show it.
        role: What its bearer may do.
        days: Days that it is valid; 0 for no end.
        link: A sign-in link of whoever makes the token; it works once.
    """
    with Client.sign_in(link, session.url or None) if link else session.client as client:
        of = find_fleet(client, fleet)
        secret = client.fleets.create_token(of.id, name, role, expires_in_days=days or None)
        if link:
            client.sign_out()
    return Reply(secret, f"{name} is {role} of {of.name} with this token, shown only now:\n{secret.token}")
