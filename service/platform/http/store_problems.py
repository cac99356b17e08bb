"""Answers with a store's bytes, and problems if the store fails."""

from __future__ import annotations

from collections.abc import AsyncIterator, Mapping

from fastapi import FastAPI, Request
from fastapi.responses import JSONResponse, StreamingResponse

from service.platform.http.problems import Problem, forbidden
from service.platform.storage.errors import MissingBlobError, StoreFullError, StoreUnavailableError
from service.platform.storage.quota import QuotaExceededError


def install(app: FastAPI) -> None:
    """Answer the store's errors in ``app`` with problem documents."""

    @app.exception_handler(MissingBlobError)
    async def on_missing(request: Request, error: MissingBlobError) -> JSONResponse:
        return Problem(410, error.code, error.message, error.hint, key=error.key).response()

    @app.exception_handler(QuotaExceededError)
    async def on_quota(request: Request, error: QuotaExceededError) -> JSONResponse:
        return forbidden(error.code, error.message, error.hint, **error.fields).response()

    @app.exception_handler(StoreFullError)
    async def on_full(request: Request, error: StoreFullError) -> JSONResponse:
        left = "no room" if error.free is None else f"only {error.free} bytes"
        return Problem(
            507,
            "disk_full",
            f"The service's store has {left} left, so it takes no uploads. What was acknowledged is kept.",
            "Ask whoever runs the service for space, then send the missing parts.",
        ).response()

    @app.exception_handler(StoreUnavailableError)
    async def on_unavailable(request: Request, error: StoreUnavailableError) -> JSONResponse:
        return Problem(
            503,
            "store_unavailable",
            "The store that holds recordings does not answer at the moment.",
            "Try again in a few seconds; /readyz says how the service is.",
            headers={"Retry-After": "5"},
        ).response()


async def streamed(pieces: AsyncIterator[bytes], media_type: str, headers: Mapping[str, str]) -> StreamingResponse:
    """An answer of a store's pieces; the first is fetched before it begins, so that a failing store is a problem."""
    first = await anext(pieces, b"")

    async def body() -> AsyncIterator[bytes]:
        yield first
        async for piece in pieces:
            yield piece

    return StreamingResponse(body(), media_type=media_type, headers=dict(headers))
