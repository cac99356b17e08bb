"""Whether the service lives (/healthz) and whether it can work (/readyz)."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from typing import Any

import redis
from fastapi import APIRouter, Request
from fastapi.responses import JSONResponse
from sqlalchemy import select, text

from service.db.clock import now
from service.db.jobs import Heartbeat, Worker
from service.db.migrate import is_older, newest
from service.db.session import Database
from service.observability.job_figures import WORKER_SILENT_S
from service.settings import Settings
from service.storage.store import Store

router = APIRouter(tags=["health"])

SWEEP = "sweep"
# The sweep beats every `sweep_s`; one long task in front of it is no alarm yet.
_SILENT_SWEEPS = 10


@router.get("/healthz")
def healthz() -> dict[str, str]:
    """The process answers."""
    return {"status": "ok"}


@router.get("/readyz")
def readyz(request: Request) -> JSONResponse:
    """200 where every part that the service needs works, else 503; the parts are in the body.

    `workers` alone does not turn it: what is asked for while none is warm waits in the table, and is done later.
    """
    settings: Settings = request.app.state.settings
    parts = {
        "database": _tried(lambda: _database(request.app.state.database)),
        "broker": _tried(lambda: _broker(settings)),
        "store": _tried(lambda: _store(request.app.state.store, settings)),
        "sweep": _tried(lambda: _sweep(request.app.state.database, settings)),
    }
    if settings.supervisor_status is not None:
        parts["children"] = _tried(lambda: _children(settings))
    ready = all(part["ok"] for part in parts.values())
    parts["workers"] = _tried(lambda: _workers(request.app.state.database))
    if request.app.state.drain.asked:
        return JSONResponse({"status": "draining", "parts": parts}, 503)
    status = "not_ready" if not ready else "ok" if parts["workers"]["ok"] else "degraded"
    return JSONResponse({"status": status, "parts": parts}, 200 if ready else 503)


def _tried(look: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    start = time.perf_counter()
    try:
        found = look()
    except Exception as error:
        found = {"ok": False, "detail": f"{type(error).__name__}: {str(error).splitlines()[0] if str(error) else ''}"}
    return found | {"milliseconds": round((time.perf_counter() - start) * 1000, 1)}


def _database(database: Database) -> dict[str, Any]:
    with database.reading() as session:
        has, wants = session.scalar(text("SELECT version_num FROM alembic_version")), newest()
    if has is None or is_older(has):
        detail = f"schema_mismatch: the schema is {has}, the code's {wants}; run python -m service.db.migrate"
        return {"ok": False, "detail": detail, "schema": has}
    if has != wants:
        return {"ok": True, "detail": f"the schema is {has}, newer than this code's {wants}", "schema": has}
    return {"ok": True, "schema": has}


def _broker(settings: Settings) -> dict[str, Any]:
    client: Any = redis.Redis.from_url(settings.events, socket_timeout=1, socket_connect_timeout=1)
    with client:
        client.ping()
    return {"ok": True}


def _store(store: Store, settings: Settings) -> dict[str, Any]:
    key = f"probe/{time.time_ns()}"
    store.put_bytes(key, b"ready?")
    store.delete(key)
    free = store.free_bytes()
    if free is not None and free < settings.min_free_bytes:
        return {"ok": False, "detail": f"only {free} bytes are free; uploads are refused", "free_bytes": free}
    return {"ok": True, "free_bytes": free}


def _sweep(database: Database, settings: Settings) -> dict[str, Any]:
    with database.reading() as session:
        found = session.execute(select(Heartbeat.at, now()).where(Heartbeat.name == SWEEP)).first()
    if found is None:
        return {"ok": False, "detail": "the sweep has never run: is there a beat and a worker?"}
    age = (found[1] - found[0]).total_seconds()
    return {"ok": age < max(_SILENT_SWEEPS * settings.sweep_s, settings.lease_s), "age_s": round(age, 1)}


def _workers(database: Database) -> dict[str, Any]:
    """Who answers, and who still compiles: the first start of a version takes about half a minute."""
    with database.reading() as session:
        rows = session.scalars(select(Worker).where(Worker.at > now(-WORKER_SILENT_S)).order_by(Worker.name)).all()
    found = [{"name": row.name, "queues": row.queues, "processes": row.processes, "warm": row.warm} for row in rows]
    warm = sum(row.warm for row in rows)
    missing = "no worker answers" if not rows else "every worker is still compiling its kernels"
    return {"ok": warm > 0, **({} if warm else {"detail": missing}), "warm": warm, "workers": found}


def _children(settings: Settings) -> dict[str, Any]:
    assert settings.supervisor_status is not None
    children = json.loads(settings.supervisor_status.read_text())["children"]
    return {"ok": all(child["state"] == "running" for child in children), "children": children}
