"""Credentials: sign-in links, sessions and tokens. Each ends with what made it, and with a higher role.

A secret is 256 random bits, shown once, kept as SHA-256 only and found by it.
"""

from __future__ import annotations

import hashlib
import secrets
from typing import Any, NamedTuple
from uuid import UUID

from sqlalchemy import delete, or_, select, update
from sqlalchemy.orm import Session

from service.platform.db.clock import moment
from service.platform.db.people import ApiToken, BrowserSession, Person, SignInLink

TOKEN_PREFIX = "apx_"


def new_secret(prefix: str = "") -> str:
    """A fresh secret in letters that fit into a header and a URL."""
    return prefix + secrets.token_urlsafe(32)


def secret_hash(secret: str) -> str:
    """Return the hash that is stored of a secret. It has 256 random bits, so a plain hash cannot be searched."""
    return hashlib.sha256(secret.encode()).hexdigest()


_MADE = (ApiToken, SignInLink, BrowserSession)


class EndedCredentials(NamedTuple):
    """Counts of the sessions, unused links and tokens that ended."""

    sessions: int = 0
    links: int = 0
    tokens: int = 0


def hold(session: Session, *person_ids: UUID) -> None:
    """Hold these people's rights and credentials until the transaction ends (PostgreSQL; SQLite has one writer).

    Whoever makes or ends credentials holds their person first. So a link is made before its person gets a higher
    role, and ends, or after, by somebody who still may make it.
    """
    rows = select(Person.id).where(Person.id.in_(person_ids)).order_by(Person.id)
    session.execute(rows.with_for_update(key_share=True)).all()


def end_credentials(session: Session, person_id: UUID, fleet_id: UUID | None = None) -> EndedCredentials:
    """End a person's sessions, unused links and tokens, and what was made with these.

    With ``fleet_id`` only tokens that act in this fleet end; those of other fleets have nothing to do with it.
    """
    hold(session, person_id)
    tokens: Any = ApiToken.person_id == person_id
    if fleet_id is not None:
        tokens &= or_(ApiToken.fleet_id == fleet_id, ApiToken.fleet_id.is_(None))
    ended = _end_ways_in(session, SignInLink.person_id == person_id, BrowserSession.person_id == person_id)
    dependents = revoke(session, tokens)
    return EndedCredentials(ended.sessions + dependents.sessions, ended.links + dependents.links, dependents.tokens)


def revoke(session: Session, which: Any) -> EndedCredentials:
    """Revoke the valid tokens among ``which``, and end what was made with them."""
    hold(session, *session.scalars(select(ApiToken.person_id).where(which, ApiToken.revoked_at.is_(None))))
    revoked = session.scalars(
        update(ApiToken)
        .where(which, ApiToken.revoked_at.is_(None))
        .values(revoked_at=moment(session))
        .returning(ApiToken.id)
        .execution_options(synchronize_session="fetch")
    ).all()
    if not revoked:
        return EndedCredentials()
    ended = _end_ways_in(session, SignInLink.made_by.in_(revoked), BrowserSession.made_by.in_(revoked))
    dependents = revoke(session, ApiToken.made_by.in_(revoked))
    return EndedCredentials(
        ended.sessions + dependents.sessions, ended.links + dependents.links, len(revoked) + dependents.tokens
    )


def hand_over(session: Session, old: list[UUID], new: UUID) -> None:
    """From now on let credentials that the ``old`` tokens made end with the ``new`` one."""
    for table in _MADE:
        session.execute(update(table).where(table.made_by.in_(old)).values(made_by=new))


def _end_ways_in(session: Session, links: Any, sessions: Any) -> EndedCredentials:
    # Links first: a link that is used at this moment leaves a session, which the second statement then sees.
    now = moment(session)
    unused = (SignInLink.used_at.is_(None), SignInLink.expires_at > now)
    ended = session.scalars(
        update(SignInLink).where(links, *unused).values(expires_at=now).returning(SignInLink.id)
    ).all()
    gone = session.scalars(delete(BrowserSession).where(sessions).returning(BrowserSession.id)).all()
    return EndedCredentials(len(gone), len(ended))
