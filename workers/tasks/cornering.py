"""Vertices of the corners that people are to mark, for a part of a detection's ranks."""

from __future__ import annotations

from collections.abc import Callable

from sqlalchemy.orm import Session

from service.platform.jobs.claims import Claim, Lease
from workers.tasks.context import Context


def corners(context: Context, held: Claim, lease: Lease) -> Callable[[Session], range]:
    """Hand over ranks ``first`` to ``stop`` of the payload: their vertices are rows made from rows."""
    ranks = range(held.payload["first"], held.payload["stop"])
    return lambda session: ranks
