"""Connections to PostgreSQL that an event loop itself waits for.

A thread that waits for an answer has to be woken twice, and shares the interpreter with the loop that it answers to:
under load that takes longer than a small statement.
"""

from __future__ import annotations

from sqlalchemy.ext.asyncio import AsyncEngine, create_async_engine

from service.db.connection import connect_args
from service.db.session import Database, ping_before_use

# Planning a statement of ten joins takes ten times as long as a few look-ups by index.
_GENERIC_PLANS = "-c plan_cache_mode=force_generic_plan"


def open_loop_engine(database: Database, connections: int, lock_s: float) -> AsyncEngine | None:
    """An engine for the same PostgreSQL, each statement a transaction of its own; None for SQLite.

    So many connections are opened at most. Who finds none free for ``lock_s`` gets SQLAlchemy's TimeoutError.
    """
    url = database.engine.url
    if database.engine.dialect.name == "sqlite":
        return None
    waits = connect_args(url, patient=False, lock_s=lock_s)
    waits |= {"options": f"{waits['options']} {_GENERIC_PLANS}", "prepare_threshold": 0}
    engine = create_async_engine(
        url,
        isolation_level="AUTOCOMMIT",
        connect_args=waits,
        pool_size=connections,
        max_overflow=0,
        pool_timeout=lock_s,
    )
    ping_before_use(engine.sync_engine)
    return engine
