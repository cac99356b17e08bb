"""Bodies of the routes about people: sign-in, members, invitations, tokens."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated
from uuid import UUID

from pydantic import Field

from apexcal.documents.base import Name, Received, Sent
from apexcal.documents.roles import Role


class SignIn(Received):
    """The secret of a sign-in link, or the whole link."""

    link: Annotated[str, Field(min_length=1, max_length=1000)]


class FleetRole(Sent):
    """A fleet and the role in it."""

    id: UUID
    name: str
    role: Role


class Me(Sent):
    """The signed-in person."""

    id: UUID
    name: str
    is_owner: bool
    fleets: list[FleetRole]


class Member(Sent):
    """A person of a fleet."""

    person_id: UUID
    name: str
    role: Role


class Ended(Sent):
    """Counts of a person's sessions, unused sign-in links and tokens that ended."""

    sessions: int
    links: int
    tokens: int


class ChangedMember(Member):
    """A member with their new role; ``ended`` counts the credentials that a higher role ended."""

    ended: Ended | None


class NewRole(Received):
    """Another role for a member."""

    role: Role


class NewInvitation(Received):
    """Whom to invite. ``person_id`` makes a new link for somebody who is a member already; that takes an admin."""

    name: Name
    role: Role
    person_id: UUID | None = None


class Invitation(Member):
    """A one-time sign-in link; it is shown this once."""

    link: str
    expires_at: datetime


class NewToken(Received):
    """A token to make: it acts as its maker, within the fleet and at most with ``role``."""

    name: Name
    role: Role
    expires_in_days: Annotated[int, Field(ge=1, le=3650)] | None = None


class Token(Sent):
    """An API token without its secret."""

    id: UUID
    name: str
    role: Role | None
    person_id: UUID
    expires_at: datetime | None
    revoked_at: datetime | None
    created_at: datetime


class MadeToken(Token):
    """An API token with its secret; it is shown this once."""

    token: str
