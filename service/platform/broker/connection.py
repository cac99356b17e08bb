"""How long a connection to the broker waits for a host that vanished, which answers nothing: as for the database."""

from __future__ import annotations

import socket
from typing import Any

from service.platform.db.connection import (
    CONNECT_S,
    KEEPALIVE_COUNT,
    KEEPALIVE_IDLE_S,
    KEEPALIVE_INTERVAL_S,
    SILENCE_S,
)

# Linux's names; elsewhere the system's own patience stays.
_PROBES = {
    "TCP_KEEPIDLE": KEEPALIVE_IDLE_S,
    "TCP_KEEPINTVL": KEEPALIVE_INTERVAL_S,
    "TCP_KEEPCNT": KEEPALIVE_COUNT,
    "TCP_USER_TIMEOUT": SILENCE_S * 1000,
}

TCP: dict[str, Any] = {
    "socket_keepalive": True,
    "socket_keepalive_options": {getattr(socket, name): s for name, s in _PROBES.items() if hasattr(socket, name)},
}
"""Options of a connection by TCP that may wait for hours, such as one that follows hints."""

CONSUMER: dict[str, Any] = {
    **TCP,
    "socket_connect_timeout": CONNECT_S,
    # A publication, and what is read once it has arrived.
    "socket_timeout": SILENCE_S,
    # A worker asks for a message for one second at a time; an answer that is so much overdue will never come.
    "health_check_interval": SILENCE_S,
}
"""Kombu's transport options of workers; it leaves out what a unix socket does not have."""


def tcp_options(url: str) -> dict[str, Any]:
    """:data:`TCP` for a client of redis-py, where ``url`` is reached by TCP."""
    return {} if url.startswith("unix:") else TCP
