"""How long a connection to PostgreSQL waits, and how long the server waits for us.

A host that vanishes answers nothing, not even that it is gone. By itself TCP tries for a quarter of an hour to send
something to it, and waits two hours or more for an answer. That long the reaper would stand still, or the locks of a
worker that vanished would hold up everybody else.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    # The broker's clients read the constants here, and need no SQLAlchemy.
    from sqlalchemy.engine import URL

# Seconds without a sign of life of the other host. Half a lease: a worker reconnects while it still holds its job.
SILENCE_S = 5
# A quiet connection is probed after 3 s, then every second: together those 5 s. A probe is a packet of 60 bytes.
KEEPALIVE_IDLE_S, KEEPALIVE_INTERVAL_S, KEEPALIVE_COUNT = 3, 1, 2
# Two trials of a host that does not even refuse; longer would keep a request waiting for more than 10 s.
CONNECT_S = 5
# For commands that read or write whole tables, whose own disk may be busy for as long.
_PATIENT_SILENCE_S = 60

# A row is locked for as long as the transaction that changed it: at most 10 s, of a large fleet request. Requests
# try for less, and again (:mod:`service.platform.http.threads`).
LOCK_S = 30
# A process that was frozen within a transaction, whose host still answers, keeps its locks no longer.
_IDLE_IN_TRANSACTION_S = 60
# Twenty times the longest statement known: to delete a recording with 100,000 vertices and 100,000 marks took 6 s on
# a busy machine.
_STATEMENT_S = 120


def connect_args(url: URL, *, patient: bool, lock_s: float = LOCK_S) -> dict[str, Any]:
    """Arguments of psycopg's ``connect``. The URL's own values take precedence.

    ``patient``: for migrations, backups and other commands of operators, whose statements take as long as they take.
    """
    silence_s = _PATIENT_SILENCE_S if patient else SILENCE_S
    ours: dict[str, Any] = {
        "connect_timeout": CONNECT_S,
        "keepalives": 1,
        "keepalives_idle": KEEPALIVE_IDLE_S,
        "keepalives_interval": KEEPALIVE_INTERVAL_S,
        "keepalives_count": KEEPALIVE_COUNT,
        # Milliseconds until something sent is acknowledged. Linux lets it end the probes too.
        "tcp_user_timeout": silence_s * 1000,
    }
    defaults = {name: value for name, value in ours.items() if name not in url.query}
    options = " ".join(f"-c {name}={value}" for name, value in _of_the_server(silence_s, lock_s, patient).items())
    return {**defaults, "options": f"{options} {url.query.get('options', '')}".strip()}


def _of_the_server(silence_s: int, lock_s: float, patient: bool) -> dict[str, int]:
    """The server's settings for our sessions: the same for our silence, and limits on what holds up others."""
    network = {
        "tcp_keepalives_idle": KEEPALIVE_IDLE_S,
        "tcp_keepalives_interval": KEEPALIVE_INTERVAL_S,
        "tcp_keepalives_count": KEEPALIVE_COUNT,
        "tcp_user_timeout": silence_s * 1000,
    }
    limits = {
        "lock_timeout": round(lock_s * 1000),
        "idle_in_transaction_session_timeout": _IDLE_IN_TRANSACTION_S * 1000,
        "statement_timeout": _STATEMENT_S * 1000,
    }
    return network if patient else network | limits
