"""Kinds of jobs.

A resource says in its ``jobs.py`` what the end and the retry of its jobs mean. Nothing here knows a resource: one
module, by name, registers the kinds of all when they are first looked up.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any, Final, Protocol, TypeVar
from uuid import UUID

from sqlalchemy.orm import InstrumentedAttribute, Mapped, Session

from apexcal.documents.states import WorkState
from service.platform.db.base import Json
from service.platform.db.jobs import Job
from service.platform.jobs.queues import QUEUES


class _Stateful(Protocol):
    state: Mapped[str]


Subject = TypeVar("Subject", bound=_Stateful)


class CannotRetryError(Exception):
    """Why failed work is not started again."""


def failed_subject(session: Session, job: Job, model: type[Subject], noun: str) -> Subject:
    """Return the locked row that a failed job worked for. Raises :class:`CannotRetryError` if it is not failed."""
    row = session.get(model, job.subject_id, with_for_update=True)
    if row is None or row.state != WorkState.FAILED:
        raise CannotRetryError(f"its {noun} is {row.state if row else 'deleted'}, no longer failed")
    return row


def existing(session: Session, model: type[Subject], ids: Collection[UUID]) -> Iterator[Subject]:
    """Return the rows of subjects that were not deleted meanwhile."""
    return (row for row in (session.get(model, id) for id in sorted(set(ids))) if row is not None)


@dataclass(frozen=True)
class Kind:
    """A kind of job, and what happens to the row that such a job works for (its subject).

    ``end(session, subject_ids, state, problem)`` runs in the transaction that ends jobs of these subjects as done,
    failed or cancelled; a subject comes once for each job. One that was deleted meanwhile hears nothing: its job must
    still be able to end.
    ``retry(session, failed_job)`` takes the subject back to where it began and returns its fresh jobs. It raises
    :class:`CannotRetryError`; without it, failed work is asked for anew.
    """

    name: str
    queue: str
    end: Callable[[Session, Collection[UUID], WorkState, Json | None], None]
    retry: Callable[[Session, Job], Sequence[Job]] | None = None
    shown_by: InstrumentedAttribute[int | None] | None = None
    """The column in which subjects keep their job's id: such a job is not removed while its subject is there."""
    take: Callable[[Session, UUID, Any], object] | None = None
    """Goes on with what a worker hands over of a subject, in the transaction that ends its job as done."""
    forget: Callable[[Session, Collection[UUID]], None] | None = None
    """Removes what nobody reads any more of subjects whose jobs go at the end of their retention."""


# Imports every resource that has jobs.
_REGISTRY: Final = "service.job_kinds"
_KINDS: dict[str, Kind] = {}


def register(*kinds: Kind) -> None:
    """Make kinds of jobs known to this process."""
    for kind in kinds:
        assert kind.queue in QUEUES, kind.queue
        _KINDS[kind.name] = kind


def kind_of(name: str) -> Kind:
    """The kind of this name."""
    return _registered()[name]


def kinds() -> Collection[Kind]:
    """All kinds."""
    return _registered().values()


@cache
def _registered() -> dict[str, Kind]:
    import_module(_REGISTRY)
    return _KINDS
