"""Transactions that are repeated after a deadlock, because what they write took minutes to compute."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import TypeVar

from sqlalchemy.exc import OperationalError

# Seconds between the tries. Together less than half a lease; a database that is away for longer is no deadlock.
_PAUSES_S = (0.05, 0.2, 0.5, 1.0, 2.0)

T = TypeVar("T")

log = logging.getLogger(__name__)


def repeated(transaction: Callable[[], T]) -> T:
    """What ``transaction`` returns; repeated where the database ended it in favour of another one.

    PostgreSQL does so in a deadlock, SQLite where it gets no lock. A connection that broke may have committed: so
    ``transaction`` must refuse to be done twice, as the gate of a job's finish does.
    """
    for pause in _PAUSES_S:
        try:
            return transaction()
        except OperationalError as error:
            log.warning("a transaction is done again: %s", str(error.orig).partition("\n")[0])
            time.sleep(pause)
    return transaction()
