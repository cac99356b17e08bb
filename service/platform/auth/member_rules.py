"""Rules of invitations: nobody grants more than their own role, or a way to act as somebody else.

A program's token grants nothing, because what it grants would outlive it.
"""

from __future__ import annotations

from uuid import UUID

from sqlalchemy import select

from apexcal.documents.roles import Role, rank
from service.platform.auth.access import Access
from service.platform.auth.credential_actions import hold
from service.platform.db.people import Membership, Person
from service.platform.http.problems import conflict, forbidden, not_found

# Engineers may invite people who mark and review; higher roles take an admin.
_ENGINEER_INVITES: Role = "reviewer"


def check_may_give(access: Access, fleet_id: UUID, role: str) -> None:
    """Raises :class:`Problem` 403 where the person may not give ``role`` in the fleet."""
    own = access.role(fleet_id)
    limit: Role = "admin" if own == "admin" else _ENGINEER_INVITES
    if own not in ("admin", "engineer") or rank(role) > rank(limit):
        raise forbidden(
            "role_too_low",
            f"As {own} you may not give the role {role}.",
            f"You may give up to {limit}; ask an admin of the fleet for more." if own == "engineer" else "",
        )


def find_member(access: Access, fleet_id: UUID, person_id: UUID) -> tuple[Membership, Person]:
    """A member of a fleet. Raises :class:`Problem` ``not_found``."""
    row = access.session.execute(
        select(Membership, Person)
        .join(Person, Person.id == Membership.person_id)
        .where(Membership.fleet_id == fleet_id, Membership.person_id == person_id)
        .with_for_update(of=Membership)
    ).first()
    if row is None:
        raise not_found()
    return row[0], row[1]


def check_leaves_an_admin(access: Access, membership: Membership, person: Person) -> None:
    """Raises :class:`Problem` 409 ``last_admin`` where the fleet, whose row is locked, has no other admin.

    An owner, who makes fleets without members and may appoint an admin at any time, may take the last one away.
    """
    others = select(Membership.person_id).where(
        Membership.fleet_id == membership.fleet_id, Membership.role == "admin", Membership.person_id != person.id
    )
    is_last = membership.role == "admin" and access.session.scalar(others.limit(1)) is None
    if is_last and not access.identity.sees_all:
        raise conflict(
            "last_admin",
            f"{person.name} is the only admin of this fleet: nobody in it could change roles any more.",
            "Make another member admin first.",
        )


def hold_to_give(access: Access, *others: UUID) -> None:
    """Hold the caller and ``others`` to change what lets them in, and look again whether the caller is let in.

    Raises :class:`Problem` 401 ``not_signed_in``, 403 ``token_gives_nothing``.
    """
    hold(access.session, access.person.id, *others)
    access.confirm()
    token = access.identity.token
    if token is not None and (token.fleet_id or token.role or token.ends):
        raise forbidden(
            "token_gives_nothing",
            "A token cannot make tokens or sign-in links or change roles: what it makes would outlive it.",
            "Sign in with a link (a browser, or `apexcal token --link`), or ask on the service's own machine.",
        )


def check_may_sign_in_as(access: Access, person: Person) -> None:
    """Raises :class:`Problem` 403 unless the caller is an admin of every fleet that ``person`` is in.

    A link signs in as its person in all of their fleets, so one fleet's word is not enough for it.
    """
    fleets = access.session.scalars(select(Membership.fleet_id).where(Membership.person_id == person.id)).all()
    if not person.is_owner and all(access.role(fleet_id) is not None for fleet_id in fleets):
        for fleet_id in fleets:
            access.need(fleet_id, "admin")
        return
    raise forbidden(
        "role_too_low",
        f"{person.name} has rights beyond this fleet, so a link for them is not yours to make.",
        "Ask whoever runs the service.",
    )
