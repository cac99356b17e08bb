"""``apexcal admin jobs``, ``job`` and ``requeue``: lists jobs, shows a job's attempts, starts failed work again."""

from __future__ import annotations

import json
from datetime import datetime
from typing import Annotated, Any

import typer
from sqlalchemy import select

from apexcal.documents.base import visible
from apexcal.documents.states import WorkState
from service.admin.context import AdminError, JsonOption, command, opened, spoken, table
from service.platform.db.jobs import Job, JobEvent
from service.platform.jobs.kinds import CannotRetryError
from service.platform.jobs.queue import retry

# What a column of the database holds.
_LARGEST = 2**63 - 1
_EVENT_COLUMNS = ("attempt", "what", "worker", "started_at", "at", "reason")
_COLUMNS = ("id", "kind", "state", "attempt", "lost", "worker", "created_at", "problem", "request_id")


@spoken
def jobs(
    state: Annotated[WorkState | None, typer.Option(help="Only jobs in this state.")] = None,
    kind: Annotated[str, typer.Option(help="Only this kind: ingest, detect, solve ...")] = "",
    request: Annotated[str, typer.Option(help="Only those that this request (X-Request-ID) caused.")] = "",
    limit: Annotated[int, typer.Option(help="At most this many, the newest.", min=1, max=10_000)] = 50,
    as_json: JsonOption = False,
) -> None:
    """List jobs, the newest first."""
    statement = select(Job).order_by(Job.id.desc()).limit(limit)
    for column, value in ((Job.state, state or ""), (Job.kind, kind), (Job.request_id, request)):
        statement = statement.where(column == value) if value else statement
    with opened() as service, service.database.reading() as session:
        rows = [_short(job) for job in session.scalars(statement)]
    print(json.dumps(rows, indent=2) if as_json else table(rows, _COLUMNS))


@spoken
def job(
    id: Annotated[int, typer.Argument(help="The job's number.", min=1, max=_LARGEST)], as_json: JsonOption = False
) -> None:
    """Show a job and what became of each attempt.

    Which worker had it, since when, how that ended: done, failed, cancelled; lost, stumbled or given back.
    """
    with opened() as service, service.database.reading() as session:
        row = session.get(Job, id)
        if row is None:
            raise AdminError(f"there is no job {id}", "Ended jobs go after APEXCAL_JOB_DAYS.")
        events = session.scalars(select(JobEvent).where(JobEvent.job_id == id).order_by(JobEvent.id)).all()
        document = {
            **_short(row),
            "queue": row.queue,
            "fleet_id": str(row.fleet_id),
            "subject_id": str(row.subject_id),
            "payload": row.payload,
            "progress": row.progress,
            "problem": row.problem,
            "lease_until": _time(row.lease_until),
            "history": [_event(event) for event in events],
        }
    if row.state == WorkState.RUNNING:
        attempt = {"attempt": row.attempt, "what": WorkState.RUNNING, "worker": row.worker}
        attempt |= {"started_at": _time(row.started_at), "at": None, "reason": None}
        document["history"].append(attempt)
    print(json.dumps(document, indent=2) if as_json else _for_people(document))


@spoken
def requeue(id: Annotated[int, typer.Argument(help="The number of a failed job.", min=1, max=_LARGEST)]) -> None:
    """Start a failed job's work anew.

    The recording, detection, analysis or run that it was for goes back to where it began, with fresh jobs.
    """
    with opened() as service, service.database.writing() as session:
        try:
            fresh = [row.id for row in retry(session, id)]
        except CannotRetryError as error:
            raise AdminError(str(error), f"{command(f'job {id}')} shows how it is.") from None
    print(f"Its work begins anew with job {', '.join(map(str, fresh))}.")


def _short(row: Job) -> dict[str, Any]:
    of_row = {"created_at": _time(row.created_at), "problem": (row.problem or {}).get("code")}
    return {name: of_row[name] if name in of_row else getattr(row, name) for name in _COLUMNS}


def _event(event: JobEvent) -> dict[str, Any]:
    return {name: getattr(event, name) for name in _EVENT_COLUMNS} | {
        name: _time(getattr(event, name)) for name in ("started_at", "at")
    }


def _for_people(document: dict[str, Any]) -> str:
    shown = {name: value for name, value in document.items() if name != "history" and value not in (None, {}, "")}
    if document["state"] != WorkState.RUNNING:
        shown.pop("progress", None)  # of an attempt that has ended
    head = "\n".join(f"{name:<12}{visible(_words(name, value))}" for name, value in shown.items())
    return f"{head}\n\n{table(document['history'], _EVENT_COLUMNS)}"


def _words(name: str, value: Any) -> str:
    """A field of a job for people; what is a document in the row as a line."""
    if name == "problem":
        return ": ".join(str(value[part]) for part in ("code", "detail") if value.get(part))
    if name == "progress":
        return f"{value.get('fraction', 0.0):.0%} {value.get('message') or ''}".rstrip()
    return json.dumps(value) if isinstance(value, dict) else str(value)


def _time(moment: datetime | None) -> str | None:
    return moment.isoformat(timespec="milliseconds") if moment else None
