"""The application with one more route, which answers nothing: what any answer costs at least."""

from __future__ import annotations

from fastapi import FastAPI, Response
from fastapi.routing import APIRoute

from service.app import create_app as create_whole

EMPTY = "/v1/empty"


async def _nothing() -> Response:
    return Response(status_code=204)


def create_app() -> FastAPI:
    """For ``uvicorn --factory``. The empty route is looked at first, as no route can be found sooner."""
    app = create_whole()
    app.router.routes.insert(0, APIRoute(EMPTY, _nothing))
    return app
