"""Whether the service lives (/healthz) and whether it can work (/readyz)."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from typing import Any

import redis
from fastapi import APIRouter, FastAPI, Request
from fastapi.responses import JSONResponse
from sqlalchemy import select

from service.db.clock import now
from service.db.ids import new_id
from service.db.jobs import Heartbeat, Worker
from service.db.revisions import is_older, newest, stored
from service.db.session import Database
from service.health.job_figures import WORKER_SILENT_S
from service.health.parts import PATIENCE_S, Answer, Part, ask_parts
from service.jobs.queues import QUEUES
from service.settings import Settings
from service.storage.store import Store

router = APIRouter(tags=["health"])

SWEEP = "sweep"
# The sweep beats every `sweep_s`; one long task in front of it is no alarm yet.
_SILENT_SWEEPS = 10
# A store that works is written to no more often than this.
_STORE_FRESH_S = 10.0


def install(app: FastAPI) -> None:
    """Give the application the parts that /readyz looks at."""
    settings: Settings = app.state.settings
    database: Database = app.state.database
    # A store of its own, which gives up about when nobody waits any more; opening one of S3 takes 10 ms.
    options = replace(settings.s3, timeout_s=min(PATIENCE_S, settings.store_timeout_s))
    store = cache(lambda: Store(settings.blobs, options))
    probe = f"probe/{new_id().hex}"
    app.state.parts = [
        Part("database", lambda: _database(database)),
        Part("broker", lambda: _broker(settings)),
        Part("store", lambda: _store(store(), probe, settings), _STORE_FRESH_S),
        Part("sweep", lambda: _sweep(database, settings)),
        *([Part("children", lambda: _children(settings))] if settings.supervisor_status else []),
        Part("workers", lambda: _workers(database)),
    ]
    app.include_router(router)


# Neither waits for one of the threads that serve requests: they may all hang with the database.
@router.get("/healthz")
async def healthz() -> dict[str, str]:
    """The process answers."""
    return {"status": "ok"}


@router.get("/readyz")
async def readyz(request: Request) -> JSONResponse:
    """200 where every part that the service needs works, else 503; the parts are in the body.

    It answers within two seconds. `workers` alone does not turn it: what is asked for while none is warm waits in the
    table, and is done later.
    """
    parts = await ask_parts(request.app.state.parts)
    ready = all(part["ok"] for name, part in parts.items() if name != "workers")
    if request.app.state.drain.asked:
        return JSONResponse({"status": "draining", "parts": parts}, 503)
    status = "not_ready" if not ready else "ok" if parts["workers"]["ok"] else "degraded"
    return JSONResponse({"status": status, "parts": parts}, 200 if ready else 503)


def _database(database: Database) -> Answer:
    with database.reading() as session:
        has, wants = stored(session), newest()
    if has is None or is_older(has):
        return {"ok": False, "detail": "schema_mismatch: older than the code; run python -m service.db.migrate"}
    return {"ok": True} if has == wants else {"ok": True, "detail": "the schema is newer than the code"}


def _broker(settings: Settings) -> Answer:
    client: Any = redis.Redis.from_url(settings.events, socket_timeout=1, socket_connect_timeout=1)
    with client:
        client.ping()
    return {"ok": True}


def _store(store: Store, probe: str, settings: Settings) -> Answer:
    free = store.free_bytes()
    if free is not None and free < settings.min_free_bytes:
        return {"ok": False, "detail": "too little room is left; uploads are refused"}
    store.put_bytes(probe, b"ready?")
    store.delete(probe)
    return {"ok": True}


def _sweep(database: Database, settings: Settings) -> Answer:
    with database.reading() as session:
        found = session.execute(select(Heartbeat.at, now()).where(Heartbeat.name == SWEEP)).first()
    if found is None:
        return {"ok": False, "detail": "the sweep has never run: is there a beat and a worker?"}
    age = (found[1] - found[0]).total_seconds()
    if age < max(_SILENT_SWEEPS * settings.sweep_s, settings.lease_s):
        return {"ok": True, "age_s": round(age, 1)}
    return {"ok": False, "detail": "the sweep is late: do beat and sweeper run?", "age_s": round(age, 1)}


def _workers(database: Database) -> Answer:
    """How many answer, and how many are warm: the first start of a version compiles for about half a minute."""
    with database.reading() as session:
        asked = select(Worker.queues, Worker.warm).where(Worker.at > now(-WORKER_SILENT_S))
        answering = session.execute(asked).all()
    warm = [queues.split(",") for queues, is_warm in answering if is_warm]
    idle = [queue for queue in QUEUES if not any(queue in queues for queues in warm)]
    missing = f"no warm worker takes the queues {', '.join(idle)}" if answering else "no worker answers"
    if answering and not warm:
        missing = "every worker is still compiling its kernels"
    return {"ok": not idle, **({"detail": missing} if idle else {}), "answering": len(answering), "warm": len(warm)}


def _children(settings: Settings) -> Answer:
    assert settings.supervisor_status is not None
    children = {
        child["name"]: child["state"] for child in json.loads(settings.supervisor_status.read_text())["children"]
    }
    down = [name for name, state in children.items() if state != "running"]
    return {"ok": not down, **({"detail": f"not running: {', '.join(down)}"} if down else {}), "children": children}
