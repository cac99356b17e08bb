"""Signing in: a link is consumed once, and gives a browser a session."""

from __future__ import annotations

from datetime import datetime, timedelta
from uuid import UUID

from sqlalchemy import delete, select, update
from sqlalchemy.orm import Session

from service.platform.auth.credential_actions import hold, new_secret, secret_hash
from service.platform.db.clock import moment
from service.platform.db.people import BrowserSession, Person, SignInLink
from service.platform.http.problems import Problem, not_found


def make_link(
    session: Session, person_id: UUID, public_url: str, hours: int, maker: UUID | None = None
) -> tuple[str, datetime]:
    """Make a one-time sign-in link; return it and its expiry. The secret is in the fragment: no log sees it.

    ``maker`` is the id of the token that asked for the link. The link and its session end with that token.
    """
    hold(session, person_id)
    secret = new_secret()
    expires_at = moment(session) + timedelta(hours=hours)
    session.add(
        SignInLink(secret_hash=secret_hash(secret), person_id=person_id, made_by=maker, expires_at=expires_at)
    )
    return f"{public_url.rstrip('/')}/sign-in#{secret}", expires_at


def sign_in(session: Session, link: str, days: int) -> tuple[Person, str]:
    """Consume a link (or its secret) and return its person and the new session's secret.

    Raises :class:`Problem` 404 ``link_unknown``, 410 ``link_used``, 410 ``link_expired``.
    """
    hashed = secret_hash(link.partition("#")[2].strip() or link.strip())
    now = moment(session)
    # One statement decides, so that of two browsers that open the link at once exactly one is signed in.
    row = session.execute(
        update(SignInLink)
        .where(SignInLink.secret_hash == hashed, SignInLink.used_at.is_(None), SignInLink.expires_at > now)
        .values(used_at=now)
        .returning(SignInLink.person_id, SignInLink.made_by)
    ).first()
    if row is None:
        raise _refusal(session, hashed)
    person_id = row.person_id
    secret = new_secret()
    session.execute(
        delete(BrowserSession).where(BrowserSession.person_id == person_id, BrowserSession.expires_at <= now)
    )
    session.add(
        BrowserSession(
            secret_hash=secret_hash(secret),
            person_id=person_id,
            made_by=row.made_by,
            expires_at=now + timedelta(days=days),
        )
    )
    return session.get_one(Person, person_id), secret


def sign_out(session: Session, secret: str) -> None:
    """End the session of this secret."""
    session.execute(delete(BrowserSession).where(BrowserSession.secret_hash == secret_hash(secret)))


def _refusal(session: Session, hashed: str) -> Problem:
    hint = "Ask whoever invited you for a new link; each signs in once."
    row = session.scalar(select(SignInLink).where(SignInLink.secret_hash == hashed))
    if row is None:
        return not_found("link_unknown", "This sign-in link is not known here.", hint)
    if row.used_at is not None:
        return Problem(410, "link_used", "This sign-in link has been used.", hint)
    return Problem(410, "link_expired", f"This sign-in link ended at {row.expires_at:%Y-%m-%d %H:%M} UTC.", hint)
