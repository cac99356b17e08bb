"""``/metrics`` for Prometheus: what this process counted and what the database knows.

Open to who has ``metrics_token``; without one, to programs on the same host that come through no proxy.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import wait
from hmac import compare_digest
from ipaddress import ip_address
from typing import Annotated, Any

from fastapi import APIRouter, Depends, FastAPI, Request, Response
from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, Gauge, generate_latest
from prometheus_client.core import GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from service.platform.health.database_figures import DatabaseFigures
from service.platform.health.parts import Part
from service.platform.http.figures import HttpFigures
from service.platform.http.problems import Problem, forbidden
from service.platform.settings import Settings

router = APIRouter(tags=["health"])

# Names by which programs on this host call it. A proxy passes on the public name or identifies itself in a header.
_OWN_NAMES = frozenset(("localhost", "127.0.0.1", "::1"))
_PROXIED = ("forwarded", "x-forwarded-", "x-real-ip", "via")


class PartFigures(Collector):
    """Whether each part that /readyz names works."""

    def __init__(self, app: FastAPI) -> None:
        self._app = app

    def describe(self) -> list[Metric]:
        """Return nothing, because it is too early for figures when the process starts."""
        return []

    def collect(self) -> Iterator[Metric]:
        """The parts' state, as fresh as /readyz has it."""
        works = GaugeMetricFamily("apexcal_part_up", "Whether a part of the service works.", labels=("part",))
        parts: list[Part] = self._app.state.parts
        answers = [(part, part.current_look()) for part in parts]
        for part, future in answers:
            wait([future], part.patience())
            works.add_metric([part.name], float(part.answer(future)["ok"]))
        yield works


def install(app: FastAPI, version: str) -> HttpFigures:
    """Give the application its figures. A registry for each application, so that two in one process stay apart."""
    registry = CollectorRegistry()
    registry.register(DatabaseFigures(app.state.database))
    registry.register(PartFigures(app))
    build = Gauge("apexcal_build_info", "The version that answers.", ("version",), registry=registry)
    build.labels(version).set(1)
    app.state.metrics = registry
    app.include_router(router)
    return HttpFigures(registry)


def _may_read(request: Request) -> None:
    settings: Settings = request.app.state.settings
    token = settings.metrics_token.get_secret_value()
    if token:
        kind, _, secret = request.headers.get("authorization", "").partition(" ")
        if kind.lower() == "bearer" and compare_digest(secret.encode(), token.encode()):
            return
        raise Problem(
            401,
            "metrics_token_wrong",
            "The metrics need the service's metrics token.",
            "Send Authorization: Bearer with the value of APEXCAL_METRICS_TOKEN.",
            headers={"WWW-Authenticate": "Bearer"},
        )
    if not _from_this_host(request):
        raise forbidden(
            "metrics_closed",
            "The metrics are open to programs on the service's own host only.",
            "Set APEXCAL_METRICS_TOKEN for the service and give it to Prometheus as its bearer token.",
        )


def _from_this_host(request: Request) -> bool:
    if request.url.hostname not in _OWN_NAMES or any(name.startswith(_PROXIED) for name in request.headers):
        return False
    peer: Any = request.client.host if request.client else ""
    try:
        return ip_address(peer).is_loopback
    except ValueError:
        return False


@router.get("/metrics", include_in_schema=False)
def get_metrics(request: Request, allowed: Annotated[None, Depends(_may_read)]) -> Response:
    """The figures in Prometheus's text format."""
    return Response(
        generate_latest(request.app.state.metrics),
        media_type=CONTENT_TYPE_LATEST,
        headers={"Cache-Control": "no-store"},
    )
