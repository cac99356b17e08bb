"""Removes expired sessions and links, and kept answers that nobody will ask for again."""

from __future__ import annotations

from datetime import timedelta

from sqlalchemy import delete

from service.platform.db.clock import moment
from service.platform.db.people import AuditEntry, BrowserSession, IdempotencyKey, SignInLink
from service.platform.db.session import Database
from service.platform.settings import get_settings

# After this time nobody repeats a request or asks why a link does not work.
_REMEMBERED = timedelta(days=14)


def remove_ended(database: Database) -> None:
    """Remove sessions that have ended, links that ended long ago, and answers that nobody will ask for again."""
    with database.writing() as session:
        now = moment(session)
        session.execute(delete(BrowserSession).where(BrowserSession.expires_at < now))
        session.execute(delete(SignInLink).where(SignInLink.expires_at < now - _REMEMBERED))
        session.execute(delete(IdempotencyKey).where(IdempotencyKey.created_at < now - _REMEMBERED))
        audited = timedelta(days=get_settings().audit_days)
        session.execute(delete(AuditEntry).where(AuditEntry.created_at < now - audited))
