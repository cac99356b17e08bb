"""The web application: ``uvicorn service.app:create_app --factory``."""

from __future__ import annotations

import asyncio
import logging
import sys
import time
from collections.abc import AsyncIterator, Callable, Collection, Sequence
from contextlib import asynccontextmanager
from importlib.metadata import version

from anyio.to_thread import current_default_thread_limiter
from fastapi import APIRouter, FastAPI
from fastapi.concurrency import run_in_threadpool

from service import description
from service.analyses import routes as analyses
from service.analyses.precision import queue_due_fits
from service.annotations import mark_routes
from service.annotations import routes as annotations
from service.calibrations import result_routes
from service.calibrations import routes as calibrations
from service.crops import routes as crops
from service.detections import routes as detections
from service.exports import routes as exports
from service.fleet_requests import routes as fleet_requests
from service.fleet_requests.actions import make_parts
from service.fleets import routes as fleets
from service.imports import routes as imports
from service.pairs import routes as pairs
from service.platform.auth import member_routes, token_routes
from service.platform.auth import routes as auth
from service.platform.auth.gate import Gate
from service.platform.auth.retention import remove_ended
from service.platform.broker.hints import COURIER as HINTS
from service.platform.broker.hints import Publisher
from service.platform.db.session import Database
from service.platform.events import routes as events
from service.platform.events.fanout import Fanout
from service.platform.garbage import imports_done
from service.platform.health import metrics_routes
from service.platform.health import routes as health
from service.platform.http import draining, etags, idempotency, problems, store_problems, threads, web
from service.platform.http.envelope import Envelope
from service.platform.http.limits import ConcurrencyLimiter
from service.platform.http.lookups import Lookups
from service.platform.job_status import routes as job_status
from service.platform.jobs.messages import COURIER as JOBS
from service.platform.jobs.messages import Sender
from service.platform.jobs.retention import forget_jobs
from service.platform.observability import logs
from service.platform.settings import Settings, settings_or_exit
from service.platform.storage.adopting import StrangeFolderError, adopt_if_known, keep_adopting
from service.platform.storage.audit import audit_if_due
from service.platform.storage.disk_reservations import DiskReservations
from service.platform.storage.quota import count_rows
from service.platform.storage.store import Store, open_store
from service.publications import routes as publications
from service.publications import vehicle_routes
from service.publications.retrieval import Retrieval
from service.recordings import (
    deletion_routes,
    frame_routes,
    original_routes,
    presigned_routes,
    sweep_routes,
    upload_routes,
)
from service.recordings import routes as recordings
from service.recordings.retention import delete_old_imports, delete_overdue, expire_uploads, remove_old_layers
from service.recordings.sweep_indexes import SweepIndexes

ROUTERS: tuple[APIRouter, ...] = (
    # First, because every vehicle asks it at every start.
    vehicle_routes.router,
    # Then what people who mark ask all the time: a request is compared with one router after the other.
    annotations.router,
    auth.router,
    member_routes.router,
    token_routes.router,
    fleets.router,
    recordings.router,
    deletion_routes.router,
    upload_routes.router,
    presigned_routes.router,
    original_routes.router,
    frame_routes.router,
    sweep_routes.router,
    job_status.router,
    events.router,
    detections.router,
    analyses.router,
    mark_routes.router,
    crops.router,
    pairs.router,
    result_routes.router,
    publications.router,
    exports.router,
    imports.router,
    calibrations.router,
    fleet_requests.router,
)

_UPKEEP_S = 600.0
# A part of the upkeep takes at most this share of a thread's time; what takes long comes more rarely.
_UPKEEP_SHARE = 0.05
_PARTS_S = 1.0
# People mark thirty frames in a minute at best.
_FITS_S = 5.0
_UPKEEP_CONNECTIONS = 2
_CANCEL_AGAIN_S = 0.1
_UPKEEP = (
    *(delete_overdue, remove_old_layers, delete_old_imports, expire_uploads),
    *(remove_ended, forget_jobs, count_rows),
)

log = logging.getLogger(__name__)


def _housework(store: Store, settings: Settings) -> Sequence[Callable[[Database], object]]:
    """Return the upkeep: functions that remove ended things and count rows."""

    def audit_store(database: Database) -> None:
        audit_if_due(database, store, settings)

    return (*_UPKEEP, audit_store)


async def _keep_house(database: Database, tasks: Sequence[Callable[[Database], object]], every_s: float) -> None:
    """Do each task every ``every_s`` seconds, or more rarely if it takes long.

    Several services doing it at once do no harm. ``database`` waits for locks longer than requests do.
    """
    due_at = dict.fromkeys(tasks, 0.0)
    while True:
        await asyncio.sleep(every_s)
        for task in due_at:
            began = time.monotonic()
            if began < due_at[task]:
                continue
            try:
                await run_in_threadpool(task, database)
            except Exception:
                log.exception("%s failed; it is tried again", task.__name__)
            ended = time.monotonic()
            due_at[task] = ended + (ended - began) / _UPKEEP_SHARE


async def _make_parts(database: Database) -> None:
    """Go on with fleet requests, every second. Several services doing it at once share the vehicles."""
    while True:
        await asyncio.sleep(_PARTS_S)
        try:
            await run_in_threadpool(make_parts, database)
        except Exception:
            log.exception("parts of fleet requests could not be made; they are tried again")


async def _end(tasks: Collection[asyncio.Task[None]]) -> None:
    """Cancel until all have ended: a library may lose one cancellation (`asyncio.wait_for` of Python 3.11 does)."""
    running = set(tasks)
    while running:
        for task in running:
            task.cancel()
        _, running = await asyncio.wait(running, timeout=_CANCEL_AGAIN_S)


def _opened(settings: Settings) -> Store:
    try:
        return open_store(settings)
    except OSError as error:
        hint = "Name a folder that this process may make and write."
        raise SystemExit(f"{settings.blobs} cannot be used as a store: {error}. {hint}") from None


def create_app(settings: Settings | None = None) -> FastAPI:
    """The application of these settings; by default of the environment's, in a process of its own.

    Raises :class:`StrangeFolderError` where the store's folder is not the database's; a process ends with its words.
    """
    if settings is None:
        settings = settings_or_exit()
        logs.configure(settings.log_form)
        try:
            return create_app(settings)
        except StrangeFolderError as error:
            raise SystemExit(f"{error}. {error.hint}") from None
    drain = draining.Drain(settings.drain_s)

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        store: Store = app.state.store
        upkeep_database = Database(settings.database, connections=_UPKEEP_CONNECTIONS)
        upkeep_database.couriers = app.state.database.couriers
        fanout = app.state.fanout = Fanout(settings.events, app.state.database, drain)
        current_default_thread_limiter().total_tokens = threads.OTHERS
        sys.setswitchinterval(threads.SWITCH_S)
        tasks = (
            keep_adopting(upkeep_database, store),
            _keep_house(upkeep_database, _housework(store, settings), _UPKEEP_S),
            _keep_house(upkeep_database, (queue_due_fits,), _FITS_S),
            _make_parts(upkeep_database),
        )
        upkeep = [asyncio.create_task(task) for task in (*tasks, fanout.feed(), fanout.watch())]
        with drain.before_stopping():
            yield
        await _end(upkeep)
        await app.state.lookups.close()
        app.state.sender.close()
        app.state.publisher.close()
        for database in (app.state.database, upkeep_database, *app.state.health_databases):
            database.close()

    app = FastAPI(
        title="apexcal",
        description="LiDAR-to-camera calibration as a distributed job service.",
        version="1",
        lifespan=lifespan,
        openapi_url="/v1/openapi.json",
        separate_input_output_schemas=False,
        # Requests are counted by `Envelope`; FastAPI asks the environment about OpenTelemetry at each of them.
        telemetry={"tracing": False, "metrics": False, "logs": False},
        docs_url=None,
        redoc_url=None,
    )
    app.state.settings = settings
    app.state.drain = drain
    app.state.database = Database(settings.database, lock_s=threads.LOCK_S, connections=threads.CONNECTIONS)
    app.state.threads = threads.Threads()
    app.state.store = _opened(settings)
    app.state.sweep_indexes = SweepIndexes(app.state.store)
    app.state.disk = DiskReservations(app.state.store, settings.min_free_bytes)
    adopt_if_known(app.state.database, app.state.store)
    app.state.lookups = Lookups(app.state.database, app.state.threads)
    app.state.retrieval = Retrieval(app.state.database, app.state.threads, app.state.lookups)
    app.state.sender = Sender(settings.broker)
    app.state.publisher = Publisher(settings.events)
    # Bodies of imports still arriving, in MiB, one of the longest for each person.
    app.state.arriving_imports = ConcurrencyLimiter(256, 32, threads.MEMORY_WAIT_S)
    app.state.database.couriers.update({JOBS: app.state.sender, HINTS: app.state.publisher})

    for module in (problems, store_problems, etags, idempotency):
        module.install(app)
    app.add_middleware(
        Envelope,
        figures=metrics_routes.install(app, version("apexcal")),
        drain=drain,
        stores=[app.state.store.origin] if app.state.store.signs else [],
    )
    health.install(app)
    # Not included: FastAPI would derive again what each route takes and answers, and match each request twice.
    app.router.routes[:0] = [route for router in ROUTERS for route in router.routes]
    app.router.middleware_stack = Gate(app.router.middleware_stack)
    web.install(app)
    description.install(app)
    return app


imports_done()
