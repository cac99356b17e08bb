"""``apexcal admin users`` and ``tokens``: lists people and tokens, makes sign-in links, revokes both."""

from __future__ import annotations

import json
import sys
from collections import defaultdict
from typing import Annotated, Any
from uuid import UUID

import typer
from sqlalchemy import select
from sqlalchemy.orm import Session

from apexcal.documents.base import visible
from apexcal.documents.served_folder import is_served, read_status
from service.admin.context import AdminError, JsonOption, as_id, command, opened, spoken, table
from service.platform.auth.credential_actions import end_credentials, revoke
from service.platform.auth.session_actions import make_link
from service.platform.db.clock import now, utc_now
from service.platform.db.effects import entry_of_process
from service.platform.db.fleets import Fleet
from service.platform.db.people import ApiToken, AuditEntry, Membership, Person
from service.platform.settings import Settings

users = typer.Typer(no_args_is_help=True, help="List people, make sign-in links, shut somebody out.")
tokens = typer.Typer(no_args_is_help=True, help="List and revoke the API tokens of programs.")


def audit(
    path: Annotated[str, typer.Argument(help="Part of an address, such as a recording's id.")] = "",
    person: Annotated[str, typer.Option(help="Name or id, as `users list` shows it.")] = "",
    days: Annotated[int, typer.Option(help="How far back.", min=1)] = 30,
    as_json: JsonOption = False,
) -> None:
    """Show who downloaded, deleted or published something, or changed roles, tokens, policies or cars' answers."""
    with opened() as service, service.database.reading() as session:
        rows = select(AuditEntry, Person.name).outerjoin(Person, Person.id == AuditEntry.person_id)
        rows = rows.where(
            AuditEntry.created_at > now(-86400.0 * days), AuditEntry.path.contains(path, autoescape=True)
        )
        if person:
            rows = rows.where(AuditEntry.person_id == find_person(session, person).id)
        entries: list[dict[str, Any]] = [
            {
                "at": f"{entry.created_at:%Y-%m-%d %H:%M:%S}",
                "person": visible(name or str(entry.person_id)),
                "token": str(entry.token_id or ""),
                "address": entry.address,
                "what": f"{entry.method} {visible(entry.path)}",
                "effect": visible((entry.effect or "").replace("\n", "; ")),
                "request": entry.request_id,
            }
            for entry, name in session.execute(rows.order_by(AuditEntry.created_at, AuditEntry.id))
        ]
    print(
        json.dumps(entries, indent=2)
        if as_json
        else table(entries, ("at", "person", "address", "what", "effect", "request"))
    )


@users.command("list")
@spoken
def list_users(as_json: JsonOption = False) -> None:
    """List everybody with their roles."""
    with opened() as service, service.database.reading() as session:
        roles: dict[UUID, list[str]] = defaultdict(list)
        statement = select(Membership.person_id, Fleet.name, Membership.role).join(
            Fleet, Fleet.id == Membership.fleet_id
        )
        for person_id, fleet, role in session.execute(statement.order_by(Fleet.name)):
            roles[person_id].append(f"{role} of {fleet}")
        rows: list[dict[str, Any]] = [
            {
                "id": str(person.id),
                "name": person.name,
                "roles": ["owner", *roles[person.id]] if person.is_owner else roles[person.id],
            }
            for person in session.scalars(select(Person).order_by(Person.name, Person.id))
        ]
    if as_json:
        print(json.dumps(rows, indent=2))
    else:
        print(table([{**row, "roles": ", ".join(row["roles"])} for row in rows], ("id", "name", "roles")))


@users.command("link")
@spoken
def link(person: Annotated[str, typer.Argument(help="Name or id, as `users list` shows it.")]) -> None:
    """Make a one-time sign-in link, also for an owner who lost every other way in."""
    with opened() as service, service.database.writing() as session:
        row = find_person(session, person)
        address, is_known = public_url(service.settings)
        url, until = make_link(session, row.id, address, service.settings.invitation_hours)
        session.add(entry_of_process(f"users link {row.id}"))
        name = visible(row.name)
    print(f"{name} signs in with this link, which works once until {until:%Y-%m-%d %H:%M} UTC:\n{url}")
    if not is_known:
        print(
            f"No service runs on {service.settings.data_dir.resolve()} now. If it starts at another address than "
            f"{address}, replace that part of the link.",
            file=sys.stderr,
        )


@users.command("revoke")
@spoken
def shut_out(person: Annotated[str, typer.Argument(help="Name or id, as `users list` shows it.")]) -> None:
    """End somebody's sessions, unused links and tokens. What they marked stays, under their name."""
    with opened() as service, service.database.writing() as session:
        row = find_person(session, person)
        ended = end_credentials(session, row.id)
        session.add(entry_of_process(f"users revoke {row.id}"))
        name = visible(row.name)
    print(f"{name}: {ended.sessions} sessions, {ended.links} links and {ended.tokens} tokens ended.")


@tokens.command("list")
@spoken
def list_tokens(
    everything: Annotated[bool, typer.Option("--all", help="Also revoked and expired ones.")] = False,
    as_json: JsonOption = False,
) -> None:
    """List tokens; none shows its secret, which is stored nowhere."""
    moment = utc_now()
    with opened() as service, service.database.reading() as session:
        statement = (
            select(ApiToken, Person.name, Fleet.name)
            .join(Person, Person.id == ApiToken.person_id)
            .outerjoin(Fleet, Fleet.id == ApiToken.fleet_id)
        )
        rows: list[dict[str, Any]] = [
            {
                "id": str(token.id),
                "name": token.name,
                "person": person,
                "fleet": fleet,
                "role": token.role,
                "state": _state(token, moment),
                "expires_at": token.expires_at.isoformat(timespec="seconds") if token.expires_at else None,
            }
            for token, person, fleet in session.execute(statement.order_by(ApiToken.created_at))
        ]
    rows = [row for row in rows if everything or row["state"] == "valid"]
    columns = ("id", "name", "person", "fleet", "role", "state", "expires_at")
    print(json.dumps(rows, indent=2) if as_json else table(rows, columns))


@tokens.command("revoke")
@spoken
def revoke_token(token: Annotated[str, typer.Argument(help="Id, as `tokens list` shows it.")]) -> None:
    """Revoke a token at once, and end the sessions, links and tokens that were made with it."""
    id = as_id(token, "token", f"{command('tokens list')} shows them.")
    with opened() as service, service.database.writing() as session:
        ended = revoke(session, ApiToken.id == id)
        session.add(entry_of_process(f"tokens revoke {id}"))
        if not ended.tokens:
            raise AdminError(f"there is no valid token {token}", f"{command('tokens list')} shows the valid ones.")
    print("It is revoked.")
    if ended.sessions or ended.links or ended.tokens > 1:
        counts = f"{ended.sessions} sessions, {ended.links} links and {ended.tokens - 1} tokens"
        print(f"What was made with it ended too: {counts}.")


def public_url(settings: Settings) -> tuple[str, bool]:
    """The address where browsers find the service, and whether it is certain.

    It is certain if the environment states it. An embedded service chooses its port when it starts, so it is also
    certain if the service runs and its data folder holds the port. Otherwise the address is the settings' default.
    """
    if settings.database_url or "public_url" in settings.model_fields_set:
        return settings.public_url, True
    address = read_status(settings.data_dir).get("public_url") if is_served(settings.data_dir) else None
    return (str(address), True) if address else (settings.public_url, False)


def _state(token: ApiToken, moment: Any) -> str:
    if token.revoked_at:
        return "revoked"
    return "expired" if token.expires_at and token.expires_at <= moment else "valid"


def find_person(session: Session, wording: str) -> Person:
    """The person with this id, or the only one with this name. Raises :class:`AdminError`."""
    people = session.scalars(select(Person).where((Person.name == wording) | (Person.id == _as_uuid(wording)))).all()
    if len(people) == 1:
        return people[0]
    if not people:
        raise AdminError(f"there is nobody called {wording!r}", f"{command('users list')} shows names and ids.")
    raise AdminError(
        f"{len(people)} people are called {wording!r}", f"Say which one by its id: {command('users list')}."
    )


def _as_uuid(text: str) -> UUID:
    """The text as an id. If it is none, the nil id, which nobody has."""
    try:
        return UUID(text)
    except ValueError:
        return UUID(int=0)
