"""Rules about who may invite whom: nobody hands out more than they have, nor a way to act as somebody greater."""

from __future__ import annotations

from uuid import UUID

from sqlalchemy import select

from service.auth.access import Access
from service.auth.roles import Role, rank
from service.db.people import Membership, Person
from service.http.problems import Problem, not_found

# An engineer brings in the people who mark and review; more than that is an admin's word.
_ENGINEER_INVITES: Role = "reviewer"


def check_may_give(access: Access, fleet_id: UUID, role: str) -> None:
    """Raises :class:`Problem` 403 where the person may not give ``role`` in the fleet."""
    held = access.role(fleet_id)
    limit: Role = "admin" if held == "admin" else _ENGINEER_INVITES
    if held not in ("admin", "engineer") or rank(role) > rank(limit):
        raise Problem(
            403,
            "role_too_low",
            f"As {held} you may not give the role {role}.",
            f"You may give up to {limit}; ask an admin of the fleet for more." if held == "engineer" else "",
        )


def find_member(access: Access, fleet_id: UUID, person_id: UUID) -> tuple[Membership, Person]:
    """A member of a fleet. Raises :class:`Problem` ``not_found``."""
    found = access.session.execute(
        select(Membership, Person)
        .join(Person, Person.id == Membership.person_id)
        .where(Membership.fleet_id == fleet_id, Membership.person_id == person_id)
        .with_for_update(of=Membership)
    ).first()
    if found is None:
        raise not_found()
    return found[0], found[1]


def check_may_sign_in_as(access: Access, person: Person) -> None:
    """Raises :class:`Problem` 403 unless the person could have given ``person`` every role that they hold.

    A link signs in as its person in all of their fleets, so one fleet's word is not enough for it.
    """
    fleets = access.session.scalars(select(Membership).where(Membership.person_id == person.id)).all()
    if not person.is_owner and all(access.role(one.fleet_id) is not None for one in fleets):
        for one in fleets:
            check_may_give(access, one.fleet_id, one.role)
        return
    raise Problem(
        403,
        "role_too_low",
        f"{person.name} has rights beyond this fleet, so a link for them is not yours to make.",
        "Ask whoever runs the service.",
    )
