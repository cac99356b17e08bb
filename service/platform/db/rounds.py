"""Rounds of the upkeep: what is done for one row after the other, whatever fails for some of them."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from typing import TypeVar

from sqlalchemy.exc import DBAPIError

log = logging.getLogger(__name__)
ItemT = TypeVar("ItemT")
OutcomeT = TypeVar("OutcomeT")


def is_away(error: Exception) -> bool:
    """Whether the database was not reached, so that nothing else can be done either."""
    # Without a statement: no connection could be opened.
    return isinstance(error, DBAPIError) and (error.connection_invalidated or error.statement is None)


def one_by_one(
    noun: str, items: Iterable[ItemT], step: Callable[[ItemT], OutcomeT], failed: set[ItemT] | None = None
) -> list[OutcomeT]:
    """Return what ``step`` returned for each item. One that fails is logged, and left for the next round.

    ``failed`` collects them. Raises at once where the database is away.
    """
    outcomes: list[OutcomeT] = []
    for item in items:
        try:
            outcomes.append(step(item))
        except Exception as error:
            if is_away(error):
                raise
            log.exception("%s %s is left for the next round", noun, item)
            if failed is not None:
                failed.add(item)
    return outcomes
