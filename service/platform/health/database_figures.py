"""Prometheus figures of the farm, read from the database: workers have no HTTP, so their rows report for them.

Every figure but the blobs' is one indexed statement or a small table. Two API processes that are asked at once answer
the same.
"""

from __future__ import annotations

import logging
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import accumulate
from typing import Any

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily, Metric
from prometheus_client.registry import Collector
from sqlalchemy import case, func, select
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.orm import Session

from apexcal.documents.states import UNENDED, WorkState
from service.platform.db.clock import now
from service.platform.db.jobs import Heartbeat, Job, JobTotal
from service.platform.db.recordings import Blob
from service.platform.db.session import Database
from service.platform.jobs.history import BUCKETS_S
from service.platform.jobs.queue import answering_workers
from service.platform.jobs.queues import QUEUES
from service.platform.jobs.reaper import resent_after_s

FRESH_S = 5.0
# All rows of blobs are counted, so more rarely: this takes a thousandth of the time at most, however many there are.
_BLOBS_FRESH_S = 60.0
_BLOBS_SHARE = 1e-3

log = logging.getLogger(__name__)


class DatabaseFigures(Collector):
    """Asked for figures, it asks the database at most every few seconds."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._figures: list[Metric] = []
        self._blobs: list[Metric] = []
        self._stale_at = self._blobs_stale_at = 0.0

    def describe(self) -> list[Metric]:
        """Return nothing, because the database should not be asked when the process starts."""
        return []

    def collect(self) -> Iterator[Metric]:
        """The figures, or that the database does not answer."""
        up = GaugeMetricFamily("apexcal_database_up", "Whether the database answered.")
        try:
            self._refresh()
            up.add_metric([], 1)
        except SQLAlchemyError as error:
            log.warning("no figures: the database does not answer (%s)", type(error).__name__)
            self._figures = []
            up.add_metric([], 0)
        yield up
        yield from self._figures
        yield from self._blobs if self._figures else []

    def _refresh(self) -> None:
        moment = time.monotonic()
        if moment < self._stale_at:
            return
        with self._database.reading() as session:
            figures = [*_queues(session), *_totals(session), *_workers(session), _heartbeats(session)]
            if moment >= self._blobs_stale_at:
                began = time.monotonic()
                self._blobs = list(_blobs(session))
                took_s = time.monotonic() - began
                self._blobs_stale_at = moment + max(_BLOBS_FRESH_S, took_s / _BLOBS_SHARE)
        self._figures, self._stale_at = figures, moment + FRESH_S


def _gauge(name: str, help_text: str, labels: Iterable[str], rows: Iterable[tuple[tuple[str, ...], float]]) -> Metric:
    family = GaugeMetricFamily(name, help_text, labels=tuple(labels))
    for values, value in rows:
        family.add_metric(values, value)
    return family


def _queues(session: Session) -> Iterator[Metric]:
    rows = session.execute(
        select(Job.queue, Job.kind, Job.state, Job.sends, func.count(), func.min(Job.send_after), now())
        .where(Job.state.in_(UNENDED))
        .group_by(Job.queue, Job.kind, Job.state, Job.sends)
    ).all()
    jobs: Counter[tuple[str, str]] = Counter()
    for _, kind, state, _, count, _, _ in rows:
        jobs[kind, state] += count
    yield _gauge("apexcal_jobs", "Jobs that have not ended, by kind and state.", ("kind", "state"), jobs.items())
    depth: dict[str, int] = dict.fromkeys(QUEUES, 0)
    oldest: dict[str, float] = dict.fromkeys(QUEUES, 0.0)
    for queue, _, state, sends, count, resent_at, moment in rows:
        if state == WorkState.QUEUED and sends and resent_at:
            depth[queue] += count
            to_come_s = (resent_at - moment).total_seconds()
            oldest[queue] = max(oldest[queue], resent_after_s(sends) - to_come_s)
    yield _gauge(
        "apexcal_queue_depth",
        "Jobs that wait for a worker: neither in backoff nor behind their fleet's window.",
        ("queue",),
        (((name,), count) for name, count in depth.items()),
    )
    yield _gauge(
        "apexcal_queue_oldest_seconds",
        "Seconds since the oldest of these was sent; 0 where none waits.",
        ("queue",),
        (((name,), age) for name, age in oldest.items()),
    )


def _totals(session: Session) -> Iterator[Metric]:
    events = CounterMetricFamily(
        "apexcal_job_events",
        "What became of jobs: done, failed, cancelled; lost, stumbled, given_back (all tried again); requeued.",
        labels=("kind", "what"),
    )
    seconds = HistogramMetricFamily(
        "apexcal_job_seconds", "Seconds from claim to end of attempts that did their job.", labels=("kind",)
    )
    for total in session.scalars(select(JobTotal).order_by(JobTotal.kind, JobTotal.what)):
        events.add_metric((total.kind, total.what), total.count)
        if total.what == WorkState.DONE and len(total.buckets) == len(BUCKETS_S) + 1:
            limits = (*map(str, BUCKETS_S), "+Inf")
            seconds.add_metric(
                (total.kind,), list(zip(limits, accumulate(total.buckets), strict=True)), sum_value=total.seconds
            )
    yield events
    yield seconds


def _workers(session: Session) -> Iterator[Metric]:
    warm: dict[bool, int] = {True: 0, False: 0}
    processes: dict[str, int] = dict.fromkeys(QUEUES, 0)
    for row in answering_workers(session):
        warm[row.warm] += 1
        for queue in set(row.queues.split(",")) & set(QUEUES):
            processes[queue] += row.processes if row.warm else 0
    yield _gauge(
        "apexcal_workers",
        "Workers that answer; a warm one has its kernels compiled.",
        ("warm",),
        (((str(state).lower(),), count) for state, count in warm.items()),
    )
    yield _gauge(
        "apexcal_worker_processes",
        "Pool processes of warm workers, by the queue that they take.",
        ("queue",),
        (((name,), count) for name, count in processes.items()),
    )


def _heartbeats(session: Session) -> Metric:
    rows: Any = session.execute(select(Heartbeat.name, Heartbeat.at, now())).all()
    return _gauge(
        "apexcal_heartbeat_age_seconds",
        "Seconds since something that must keep happening happened: the sweep, a backup.",
        ("name",),
        (((name,), (moment - at).total_seconds()) for name, at, moment in rows),
    )


def _blobs(session: Session) -> Iterator[Metric]:
    by_state = case((Blob.state.in_(("reserved", "stored", "condemned")), Blob.state), else_="other")
    rows = session.execute(
        select(by_state, func.count(), func.coalesce(func.sum(Blob.size), 0)).group_by(by_state)
    ).all()
    yield _gauge(
        "apexcal_blobs", "Objects of the store by state.", ("state",), (((state,), count) for state, count, _ in rows)
    )
    yield _gauge(
        "apexcal_blob_bytes",
        "Bytes of the store's objects by state; of reserved ones they are not known yet.",
        ("state",),
        (((state,), float(size)) for state, _, size in rows),
    )
