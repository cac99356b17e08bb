"""The router of every resource: all that a request does with the database is one call in one thread.

That call opens the session, runs the route, renders the answer and commits. FastAPI runs these steps in separate pool
calls: then a lock holder waits for a thread while the threads wait for its lock.
"""

from __future__ import annotations

import functools
import inspect
import json
import logging
import re
import warnings
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from typing import Any, Literal
from urllib.parse import quote
from uuid import UUID

from fastapi import APIRouter, Request, Response
from fastapi.dependencies.utils import get_flat_params
from fastapi.exceptions import ResponseValidationError
from fastapi.params import Query
from fastapi.responses import JSONResponse
from fastapi.routing import APIRoute
from pydantic.warnings import UnsupportedFieldAttributeWarning
from sqlalchemy.exc import SQLAlchemyError
from starlette.routing import compile_path

from service.platform.db.base import Json
from service.platform.db.effects import ENTRY, effects
from service.platform.db.people import AuditEntry
from service.platform.db.session import Database
from service.platform.http.problems import Problem, check_query, unprocessable
from service.platform.http.threads import Lane, Threads
from service.platform.observability import logs, request_ids

log = logging.getLogger(__name__)

# Largest bodies of requests. A larger declared length is answered 413 before a byte is read; a body without a
# declared length is cut off there. A route that takes more than DEFAULT states `max_body_size`. Bodies up to DOCUMENT
# are parsed on the event loop: the worst of that length, a quarter of a million brackets, blocks it for 10 to 20 ms.
KIB = 1024
# Names, answers to marking tasks, calibrations: the largest of them, with 16 lenses, has some 20 KiB.
DEFAULT = 64 * KIB
# Rigs of 16 cameras with 240 transforms, regions of many polygons, requests for 5,000 vehicles (200 KB).
DOCUMENT = 256 * KIB
# A sign-in link has at most 1,000 letters.
SIGN_IN = 4 * KIB

# Whole files that leave the service. Frames and sweeps are read by the thousand: only the log has these.
_DOWNLOADS = re.compile(r"/(original(/parts)?|analyses/{\w+}/file|correspondence-sets/{\w+})$")
_AUDITED = re.compile(
    r"^DELETE |^(POST|PUT|PATCH) .*/(fleets/{\w+}|members/{\w+}|invitations|tokens|policy|publication|withdrawal)$"
)

CREATED = frozenset((201, 202))
_READS = frozenset(("GET", "HEAD"))
_STEPS = frozenset(("cancel", "complete", "retry"))
"""Last words of addresses that change the resource before them."""
_LISTED = "/v1/vehicles/{vehicle_id}/cameras/{camera}/publications"
_LOCATIONS = {
    "invitations": "/v1/fleets/{id}/members",
    "publication": _LISTED,
    "selections": "/v1/correspondence-sets/{new_id}",
    "withdrawal": _LISTED,
}
"""Location of created resources whose path differs from the request's. An invited person is a member."""
DRY_RUN = "Dry-Run"
"""Header of a request that changes nothing: its answer lists the answers to cars that it would change."""
# Callers who sign in have no identity yet. All of them share one person's part of a lane.
_STRANGERS = UUID(int=0).hex
_VERBS = {"GET": "get", "POST": "create", "PATCH": "update", "PUT": "put", "DELETE": "delete"}


@dataclass(frozen=True)
class Transaction:
    """A session to be opened in the route's own thread. A route's parameter is what ``open`` yields."""

    open: Callable[[], AbstractContextManager[Any]]
    writes: bool


class _DryRun(Exception):  # noqa: N818 - an answer, not an error
    """The end of a transaction that was only to show its effects."""

    def __init__(self, effects: list[str]) -> None:
        super().__init__()
        self.effects = effects


class Route(APIRoute):
    """A route that is one call in one thread, and that checks the names in its query.

    Its parameters and answers are derived at its first request: for all routes together that takes a quarter of the
    start.
    """

    writers: Literal["writing", "marking"] = "writing"

    def __init__(self, path: str, endpoint: Callable[..., Any], **options: Any) -> None:
        # Requests are matched by these.
        self.path_regex, self.path_format, self.param_convertors = compile_path(path)
        self.path = path
        self.methods = {*(options.get("methods") or ("GET",))}
        self._definition = (path, endpoint, options)

    def __getattr__(self, name: str) -> Any:
        """Derive the route when an attribute is first missing, and return that attribute."""
        definition = vars(self).pop("_definition", None)
        if definition is None:
            raise AttributeError(name)
        path, endpoint, options = definition
        self._is_plain = not inspect.iscoroutinefunction(endpoint)
        super().__init__(path, self._run_in_thread(endpoint) if self._is_plain else endpoint, **options)
        with warnings.catch_warnings():
            # As in FastAPI; bodies are built when they are first read.
            warnings.simplefilter("ignore", UnsupportedFieldAttributeWarning)
            for body in self.dependant.body_params:
                body.validate(None)
        return getattr(self, name)

    def get_route_handler(self) -> Callable[[Request], Any]:
        """Return FastAPI's handler, behind a check of the names in the query."""
        handler = super().get_route_handler()
        is_download = _DOWNLOADS.search(self.path) is not None
        parameters = get_flat_params(self.dependant)
        names = sorted({parameter.alias for parameter in parameters if isinstance(parameter.field_info, Query)})

        async def checked(request: Request) -> Response:
            check_query(request.query_params, names)
            if DRY_RUN in request.headers and not self._is_plain:
                raise _no_dry_run()
            answer = await handler(request)
            if is_download and answer.status_code < 300:
                await _note_download(request)
            return with_location(request, answer)

        return checked

    def _run_in_thread(self, endpoint: Callable[..., Any]) -> Callable[..., Any]:
        signature = inspect.signature(endpoint, eval_str=True)
        # FastAPI passes the request to one parameter, and to another the response that dependencies have changed.
        names = {_name_of(kind, signature): kind for kind in (Request, Response)}
        more = [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, annotation=kind)
            for name, kind in names.items()
            if name not in signature.parameters
        ]

        @functools.wraps(endpoint)
        async def called(**values: Any) -> Response:
            request, injected = (values[name] for name in names)
            for parameter in more:
                del values[parameter.name]
            threads: Threads = request.app.state.threads
            sessions = [value for value in values.values() if isinstance(value, Transaction)]
            reads = not any(value.writes for value in sessions) and (sessions or request.method in _READS)
            lane: Lane = threads.reading if reads else getattr(threads, self.writers)
            # A POST that stores nothing computes on its own body.
            run = threads.parse if reads and request.method not in _READS else lane.run
            caller = UUID(logs.who().get("person") or _STRANGERS)
            is_dry = DRY_RUN in request.headers
            return await run(self._answer, endpoint, values, injected, audit_entry(request), is_dry, caller=caller)

        called.__signature__ = signature.replace(  # pyright: ignore[reportAttributeAccessIssue]
            parameters=[*signature.parameters.values(), *more]
        )
        return called

    def _answer(
        self, endpoint: Callable[..., Any], values: dict[str, Any], injected: Response, entry: Json, is_dry: bool
    ) -> Response:
        writing = [name for name, value in values.items() if isinstance(value, Transaction) and value.writes]
        if is_dry and not writing:
            raise _no_dry_run()
        try:
            with ExitStack() as stack:
                opened = {
                    name: stack.enter_context(value.open()) if isinstance(value, Transaction) else value
                    for name, value in values.items()
                }
                answer = endpoint(**opened)
                for session in (opened[name].opened_session for name in writing):
                    if is_dry:
                        raise _DryRun(effects(session))
                    session.info[ENTRY] = AuditEntry(**entry)
                    if _AUDITED.search(f"{entry['method']} {self.path}"):
                        session.add(session.info[ENTRY])
                return answer if isinstance(answer, Response) else self._rendered(answer, injected)
        except _DryRun as run:
            return JSONResponse({"effects": run.effects})

    def _rendered(self, answer: Any, injected: Response) -> Response:
        """Return the answer by its model, with the status and headers that the route set."""
        content = None
        if self.response_field is not None:
            valid, errors = self.response_field.validate(answer, {}, loc=("response",))
            if errors:
                raise ResponseValidationError(errors=errors, body=answer)
            content = self.response_field.serialize_json(valid)
        status = injected.status_code or self.status_code or 200
        response = Response(content, status, media_type="application/json" if content is not None else None)
        response.headers.raw.extend(injected.headers.raw)
        return response


def audit_entry(request: Request) -> Json:
    """Return a row of the audit: who sends this request, and to which address."""
    who = logs.who()
    ids = {f"{name}_id": UUID(who[name]) if name in who else None for name in ("person", "token")}
    where = {"address": who.get("address", ""), "request_id": request_ids.current()}
    return {**ids, **where, "method": request.method, "path": request.url.path[:500]}


def _no_dry_run() -> Problem:
    return unprocessable(
        "no_dry_run", "Of this request nobody can say before what it changes.", f"Send it without {DRY_RUN}."
    )


async def _note_download(request: Request) -> None:
    """Write a download to the audit before its first byte. It is served even if the database takes no writes."""

    def write(database: Database) -> None:
        with database.writing() as session:
            session.add(AuditEntry(**audit_entry(request)))

    try:
        await request.app.state.threads.writing.run(write, request.app.state.database)
    except (SQLAlchemyError, Problem):
        log.warning("a download is not in the audit: %s", request.url.path)


def location_of(path: str) -> str:
    """Return the path of the resource that a POST to ``path`` creates or acts on. ``{new_id}`` is the answer's id."""
    parent, _, last = path.rpartition("/")
    return _LOCATIONS.get(last) or (parent if last in _STEPS else f"/v1/{last}/{{new_id}}")


def with_location(request: Request, answer: Response) -> Response:
    """Return the answer with the Location of what it created or started (201, 202)."""
    if answer.status_code in CREATED:
        document = json.loads(bytes(answer.body))
        parts = {"vehicle_id": document.get("vehicle_id"), "camera": document.get("camera"), **request.path_params}
        path = location_of(request.scope["route"].path_format).format(**parts, new_id=document.get("id"))
        answer.headers["Location"] = quote(request.scope.get("root_path", "") + path)
    return answer


def _name_of(kind: type, signature: inspect.Signature) -> str:
    """Return the name of the parameter of exactly this type, or of a new one."""
    names = (name for name, parameter in signature.parameters.items() if parameter.annotation is kind)
    return next(names, f"_{kind.__name__.lower()}")


class MarkingRoute(Route):
    """A route that many people who mark call at once; those that write use the marking lane."""

    writers = "marking"


class Router(APIRouter):
    """A resource's router. Its routes hold their whole address, so that the application takes them unchanged."""

    def __init__(self, *, tags: list[str], route_class: type[Route] = Route) -> None:
        super().__init__(
            prefix="/v1",
            tags=[*tags],
            route_class=route_class,
            max_body_size=DEFAULT,
            generate_unique_id_function=operation_id,
        )


def operation_id(route: APIRoute) -> str:
    """Return an operation's name in the description, by method and address: `vehicles.list`, `recordings.complete`.

    A route whose name another one has states its own.
    """
    method = min(route.methods or {"GET"})
    parts = [part.replace("-", "_") for part in route.path_format.removeprefix("/v1").split("/")[1:]]
    *parents, last = [part for part in parts if not part.startswith("{")]
    verb = _VERBS[method]
    if parts[-1].startswith("{"):
        return f"{last}.{verb}"
    if last.endswith("s") and not last.endswith("ss") and method in ("GET", "POST"):
        return f"{last}.{'list' if method == 'GET' else verb}"
    if method == "POST":
        return ".".join([*parents[-1:], last])
    return f"{parents[-1]}.{verb}_{last}" if parents else f"{last}.{verb}"


def header(name: str, description: str, *, required: bool = False) -> dict[str, Any]:
    """Return a header as the description of an operation lists it."""
    schema = {"type": "string", "title": name}
    return {"name": name, "in": "header", "required": required, "schema": schema, "description": description}
