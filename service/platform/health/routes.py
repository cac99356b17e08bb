"""Whether the process lives (/healthz), and whether it can answer (/readyz)."""

from __future__ import annotations

import json
import logging
from dataclasses import replace
from functools import cache
from typing import Any

from fastapi import APIRouter, FastAPI, Request
from fastapi.responses import JSONResponse
from sqlalchemy import select
from sqlalchemy.exc import DBAPIError

from service.platform.db.base import new_id
from service.platform.db.clock import now
from service.platform.db.jobs import Heartbeat
from service.platform.db.revisions import is_older, newest, stored
from service.platform.db.session import Database, put
from service.platform.health.parts import PATIENCE_S, Answer, Part, ask_parts
from service.platform.http.router import operation_id
from service.platform.jobs.queue import answering_workers
from service.platform.jobs.queues import QUEUES
from service.platform.settings import Settings
from service.platform.storage.store import Store

router = APIRouter(tags=["health"], generate_unique_id_function=operation_id)

DATABASE = "database"
SWEEP = "sweep"
# The sweep beats every `sweep_s`; one long task in front of it is no alarm yet.
_SILENT_SWEEPS = 10
# A store that works is written to no more often than this.
_STORE_FRESH_S = 10.0
_WRITES_FRESH_S = 5.0

log = logging.getLogger(__name__)


def install(app: FastAPI) -> None:
    """Give the application the parts that /readyz looks at."""
    settings: Settings = app.state.settings
    # A store of its own, which gives up about when nobody waits any more; opening one of S3 takes 10 ms.
    options = replace(settings.s3, timeout_s=min(PATIENCE_S, settings.store_timeout_s))
    store = cache(lambda: Store(settings.blobs, options))
    probe = f"probe/{new_id().hex}"
    # Connections of its own: requests that have taken all the others make no process unready. What decides about
    # readiness shares its one with no other part: where the server has none left, it is still there.
    reads, own = app.state.health_databases = (
        Database(settings.database, connections=1),
        Database(settings.database),
    )
    app.state.parts = [
        Part(DATABASE, lambda: _database(reads)),
        Part("writes", lambda: _writes(own), _WRITES_FRESH_S),
        Part("broker", lambda: _broker(settings)),
        Part("store", lambda: _store(store(), probe, settings), _STORE_FRESH_S),
        Part(SWEEP, lambda: _sweep(own, settings)),
        *([Part("children", lambda: _children(settings))] if settings.supervisor_status else []),
        Part("workers", lambda: _workers(own)),
    ]
    app.include_router(router)


# Neither waits for one of the threads that serve requests: they may all hang with the database.
@router.get("/healthz")
async def healthz() -> dict[str, str]:
    """The process answers."""
    return {"status": "ok"}


@router.get("/readyz")
async def readyz(request: Request) -> JSONResponse:
    """200 where the database answers reads with this code's schema: vehicles need no more. Else, or draining, 503.

    It answers within two seconds. Every process shares the other parts, so one that is ill is no reason to ask
    another process: `degraded` names it and says what is wrong.
    """
    parts = await ask_parts(request.app.state.parts)
    ill = [f"{name}: {part['detail']}" for name, part in parts.items() if not part["ok"]]
    away = "draining" if request.app.state.drain.asked else "" if parts[DATABASE]["ok"] else "not_ready"
    status = away or ("degraded" if ill else "ok")
    return JSONResponse({"status": status, "degraded": ill, "parts": parts}, 503 if away else 200)


def _database(database: Database) -> Answer:
    with database.reading() as session:
        has, wants = stored(session), newest()
    if has is None or is_older(has):
        return {
            "ok": False,
            "detail": "schema_mismatch: older than the code; run python -m service.platform.db.migrate",
        }
    return {"ok": True} if has == wants else {"ok": True, "detail": "the schema is newer than the code"}


def _writes(database: Database) -> Answer:
    try:
        with database.writing() as session:
            put(session, Heartbeat, {"name": "writes"}, {"at": now()})
    except DBAPIError as error:
        log.warning("the database takes no writes: %s", error.orig)
        return {"ok": False, "detail": "the database takes no writes: it is full, read-only, locked or away"}
    return {"ok": True}


def _broker(settings: Settings) -> Answer:
    import redis

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
        times = session.execute(select(Heartbeat.at, now()).where(Heartbeat.name == SWEEP)).first()
    if times is None:
        return {"ok": False, "detail": "the sweep has never run: is there a sweeper?"}
    age = (times[1] - times[0]).total_seconds()
    if age < max(_SILENT_SWEEPS * settings.sweep_s, settings.lease_s):
        return {"ok": True, "age_s": round(age, 1)}
    return {"ok": False, "detail": "the sweep is late: does the sweeper run?", "age_s": round(age, 1)}


def _workers(database: Database) -> Answer:
    """How many answer, and how many are warm: the first start of a version compiles for about half a minute."""
    with database.reading() as session:
        answering = [(worker.queues.split(","), worker.warm) for worker in answering_workers(session)]
    warm = [queues for queues, is_warm in answering if is_warm]
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
