"""The figures of one API process: requests by method, route and status, and how long they took."""

from __future__ import annotations

from functools import cache

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, disable_created_metrics

# No series that says when each counter began: nothing here reads it.
disable_created_metrics()

_SECONDS = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0)
_METHODS = frozenset(("GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"))


class HttpFigures:
    """Labels take few values: a route is its template, never an address that somebody sent."""

    def __init__(self, registry: CollectorRegistry) -> None:
        self._count = Counter(
            "apexcal_http_requests",
            "Requests that this process answered.",
            ("method", "route", "status"),
            registry=registry,
        )
        self._seconds = Histogram(
            "apexcal_http_request_seconds",
            "Seconds from a request's arrival to the end of its answer, by route.",
            ("route",),
            buckets=_SECONDS,
            registry=registry,
        )
        self.in_flight = Gauge(
            "apexcal_http_requests_in_flight",
            "Requests that are being answered, streams included.",
            registry=registry,
        )

        # A series is looked up once: each look takes a lock and makes texts of its labels.
        self._count_of = cache(self._count.labels)
        self._seconds_of = cache(self._seconds.labels)

    def answered(self, method: str, route: str, status: int, seconds: float) -> None:
        """Count one."""
        self._count_of(method if method in _METHODS else "other", route, status).inc()
        self._seconds_of(route).observe(seconds)
