"""Tables of people, memberships and credentials. Secrets are stored as SHA-256 only."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated
from uuid import UUID

from sqlalchemy import String, UniqueConstraint, Uuid
from sqlalchemy.orm import Mapped, mapped_column

from service.platform.db.base import Base, Created, Dated, Digest, Json, Name, belongs_to

# The token that it was made with, and ends with. No foreign key: a younger token may take its place (`hand_over`),
# and a backup is restored in the order of ids.
MadeBy = Annotated[UUID | None, mapped_column(Uuid)]


class Person(Dated):
    """Somebody who signs in, or a program that has a token. An owner may make fleets and sees all of them."""

    name: Mapped[Name]
    is_owner: Mapped[bool] = mapped_column(default=False)


class Membership(Base):
    """A person's role in one fleet."""

    person_id: Mapped[UUID] = belongs_to("person.id", primary_key=True)
    fleet_id: Mapped[UUID] = belongs_to("fleet.id", primary_key=True)
    role: Mapped[str] = mapped_column(String(20))
    created_at: Mapped[Created]


class SignInLink(Dated):
    """A link that signs its person in once."""

    secret_hash: Mapped[Digest] = mapped_column(unique=True)
    person_id: Mapped[UUID] = belongs_to("person.id")
    made_by: Mapped[MadeBy]
    expires_at: Mapped[datetime] = mapped_column(index=True)
    used_at: Mapped[datetime | None]


class BrowserSession(Dated):
    """A signed-in browser."""

    secret_hash: Mapped[Digest] = mapped_column(unique=True)
    person_id: Mapped[UUID] = belongs_to("person.id")
    made_by: Mapped[MadeBy]
    expires_at: Mapped[datetime] = mapped_column(index=True)


class ApiToken(Dated):
    """A program's bearer token: it acts as its person, within one fleet and role where these are given."""

    secret_hash: Mapped[Digest] = mapped_column(unique=True)
    name: Mapped[Name]
    person_id: Mapped[UUID] = belongs_to("person.id")
    fleet_id: Mapped[UUID | None] = belongs_to("fleet.id", nullable=True)
    role: Mapped[str | None] = mapped_column(String(20))
    made_by: Mapped[MadeBy]
    expires_at: Mapped[datetime | None]
    revoked_at: Mapped[datetime | None]


class AuditEntry(Dated):
    """Who downloaded, deleted or published something, or changed roles, credentials or what cars are answered.

    Ids name rows that may be gone; ``path`` names the thing. ``effect``: what cars were answered before and after.
    ``method`` is JOB, ADMIN or SERVICE where it was no request.
    """

    person_id: Mapped[UUID | None]
    token_id: Mapped[UUID | None]
    address: Mapped[str] = mapped_column(String(64))
    request_id: Mapped[str | None] = mapped_column(String(64), index=True)
    method: Mapped[str] = mapped_column(String(8))
    path: Mapped[str] = mapped_column(String(500))
    effect: Mapped[str | None]
    created_at: Mapped[Created] = mapped_column(index=True)


class IdempotencyKey(Dated):
    """The answer that was given to a POST, kept so that a repeated one gets it again.

    ``fleet_id`` and ``role`` are what the POST took: the answer is repeated only to who still has them. There is no
    ``body`` where it held a secret.
    """

    __table_args__ = (UniqueConstraint("person_id", "key"),)

    person_id: Mapped[UUID] = belongs_to("person.id")
    key: Mapped[Name]
    request_hash: Mapped[Digest]
    fleet_id: Mapped[UUID | None] = belongs_to("fleet.id", nullable=True)
    role: Mapped[str | None] = mapped_column(String(20))
    status: Mapped[int]
    body: Mapped[Json | None]
    created_at: Mapped[Created] = mapped_column(index=True)
