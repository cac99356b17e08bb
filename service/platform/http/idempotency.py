"""Idempotency-Key: a POST that is sent again gets the answer of the first time.

The answer is stored in the transaction that creates the resource, so either both exist or neither. If it holds a
secret, only the fact that it was answered is stored.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any
from uuid import UUID

from fastapi import FastAPI, Request
from fastapi.responses import JSONResponse, Response
from sqlalchemy import func, select
from sqlalchemy.orm import Session

from service.platform.db.people import IdempotencyKey
from service.platform.http.problems import conflict, unprocessable
from service.platform.http.router import with_location


class Repeated(Exception):  # noqa: N818 - an answer, not an error
    """This request was answered before."""

    def __init__(self, status: int, body: dict[str, Any]) -> None:
        super().__init__(status)
        self.status = status
        self.body = body


@dataclass(frozen=True)
class RequestKey:
    """A request's Idempotency-Key and the hash of its credential, route and body."""

    key: str
    request_hash: str


def of_caller(key: RequestKey, *caller: object) -> RequestKey:
    """Return the same key with a hash that includes the caller: a session or token, and its limits."""
    digest = hashlib.sha256("\n".join([key.request_hash, *map(str, caller)]).encode())
    return RequestKey(key.key, digest.hexdigest())


async def request_key(request: Request) -> RequestKey | None:
    """Return the key of a POST that has one, else None. Raises :class:`Problem` ``invalid_request``."""
    key = request.headers.get("idempotency-key")
    if key is None or request.method != "POST":
        return None
    if not 0 < len(key) <= 200 or not key.isprintable():
        detail = "Idempotency-Key has between 1 and 200 printable characters."
        raise unprocessable("invalid_request", detail, "Send a UUID.")
    scope = request.scope
    digest = hashlib.sha256(f"{scope['method']} {scope['path']}?".encode(errors="surrogatepass"))
    digest.update(scope["query_string"] + b"\n" + await request.body())
    return RequestKey(key, digest.hexdigest())


def kept_answer(session: Session, person_id: UUID, key: RequestKey) -> IdempotencyKey | None:
    """Return the stored answer of this key, or None if the key is new.

    Raises :class:`Problem` ``idempotency_key_reused`` if the key belongs to another request.
    """
    if session.get_bind().dialect.name == "postgresql":
        # Copies of one request wait here for each other; SQLite has one writer at a time anyway.
        session.execute(select(func.pg_advisory_xact_lock(_lock_number(person_id, key.key))))
    row = session.scalar(
        select(IdempotencyKey).where(IdempotencyKey.person_id == person_id, IdempotencyKey.key == key.key)
    )
    if row is not None and row.request_hash != key.request_hash:
        raise unprocessable(
            "idempotency_key_reused",
            "This Idempotency-Key was sent before with another request, or by another session or token.",
            "Use a fresh key for every new request, and the same key only to repeat one exactly.",
        )
    return row


def repeat(row: IdempotencyKey) -> Repeated:
    """Return the stored answer, to be raised. Raises :class:`Problem` ``answer_not_kept`` if it held a secret."""
    if row.body is not None:
        return Repeated(row.status, row.body)
    raise conflict(
        "answer_not_kept",
        "This request was done before. Its answer held a secret, which is shown once and not kept.",
        "If that answer never came, remove what the first request made and send it with a fresh Idempotency-Key.",
    )


def _lock_number(person_id: UUID, key: str) -> int:
    digest = hashlib.sha256(person_id.bytes + key.encode()).digest()
    return int.from_bytes(digest[:8], "big", signed=True)


def install(app: FastAPI) -> None:
    """Answer :class:`Repeated` with the stored answer."""

    @app.exception_handler(Repeated)
    async def on_repeated(request: Request, error: Repeated) -> Response:
        answer = JSONResponse(error.body, status_code=error.status, headers={"Idempotency-Replayed": "true"})
        return with_location(request, answer)
