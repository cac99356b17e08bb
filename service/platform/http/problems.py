"""Problem details (RFC 9457): every refusal says what is wrong, in a stable code, and what to do."""

from __future__ import annotations

import copyreg
import json
import logging
from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from functools import partial
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from sqlalchemy.exc import DBAPIError, IntegrityError, OperationalError, ProgrammingError
from sqlalchemy.exc import TimeoutError as PoolTimeout
from starlette.exceptions import HTTPException

from apexcal.documents.errors import DocumentError
from service.platform.observability import request_ids

MEDIA_TYPE = "application/problem+json"

# More are of one kind; thousands of wrong fields would be answered with megabytes.
_MOST_ERRORS = 50

log = logging.getLogger(__name__)


class Problem(Exception):  # noqa: N818 - it is the document, not only an error
    """A refusal that its reader can act on. ``fields`` are further members of the document."""

    def __init__(
        self,
        status: int,
        code: str,
        detail: str,
        hint: str = "",
        *,
        headers: Mapping[str, str] | None = None,
        **fields: Any,
    ) -> None:
        super().__init__(f"{code}: {detail}")
        self.status = status
        self.code = code
        self.detail = detail
        self.hint = hint
        self.headers = headers
        self.fields = fields

    def __reduce__(self) -> tuple[Any, ...]:
        """An error's own would call the constructor with the message alone."""
        return copyreg.__newobj__, (type(self), *self.args), self.__dict__  # pyright: ignore[reportAttributeAccessIssue]

    def document(self) -> dict[str, Any]:
        """The problem document."""
        return {
            "type": f"urn:apexcal:problem:{self.code}",
            "title": self.code.replace("_", " ").capitalize(),
            "status": self.status,
            "detail": self.detail,
            "code": self.code,
            "hint": self.hint,
            **self.fields,
        }

    def response(self) -> JSONResponse:
        """The document as an answer."""
        return _ProblemResponse(
            self.document(), status_code=self.status, media_type=MEDIA_TYPE, headers=dict(self.headers or {})
        )


class _ProblemResponse(JSONResponse):
    """A problem that may quote text that is no text: half a surrogate pair is spelled as JSON escapes it."""

    def render(self, content: Any) -> bytes:
        """The document's bytes."""
        return json.dumps(content, ensure_ascii=False, allow_nan=False).encode(errors="backslashreplace")


forbidden = partial(Problem, 403)
"""The person may not do this."""
conflict = partial(Problem, 409)
"""The present state does not allow this."""
unprocessable = partial(Problem, 422)
"""The request itself is wrong."""


def not_found(
    code: str = "not_found",
    detail: str = "There is nothing of this id that you may see.",
    hint: str = "Check the id and which fleet it is in.",
    **fields: Any,
) -> Problem:
    """Return the problem of a resource that does not exist, or that the person may not know of.

    By default it does not name the resource: a route that reads several rows would reveal which of them exist.
    """
    return Problem(404, code, detail, hint, **fields)


def schema_mismatch() -> Problem:
    """The database's schema is older or newer than the code."""
    return Problem(
        503,
        "schema_mismatch",
        "The database lacks a table or column that this version of the service uses.",
        "Stop every process of the service, run `python -m service.platform.db.migrate`, start them in one version.",
    )


def _is_of_another_schema(error: DBAPIError) -> bool:
    message = str(error.orig)
    return type(error.orig).__name__ in ("UndefinedColumn", "UndefinedTable") or any(
        words in message for words in ("no such column", "no such table", "has no column named")
    )


_LATER = "Nothing was changed. Send the request again in a few seconds; /readyz says how the service is."
_LOCKED = "locked"
_ASK = "Nothing was changed, and what was stored is kept. Ask whoever runs the service, then send it again."
# What PostgreSQL (by its SQLSTATE; refused connections have none) and SQLite say, the code, and what it means.
_FAILURES = (
    (("55P03", "40P01", "database is locked"), _LOCKED, "Others change the same thing at the moment.", _LATER),
    (("53100", "database or disk is full"), "database_full", "The database has no room left.", _ASK),
    (("25006", "readonly database"), "database_read_only", "The database takes no writes at the moment.", _LATER),
    (
        ("53300", "too many clients", "too many connections", "connection slots", "QueuePool limit"),
        "database_busy",
        "The database has no free connection at the moment.",
        _LATER,
    ),
)


def _failure_of(error: Exception) -> tuple[str, str, str]:
    """Code, detail and hint of what the database, or the pool of connections to it, fails with."""
    cause = getattr(error, "orig", None) or error
    message = f"{getattr(cause, 'sqlstate', None)} {cause}"
    for signs, code, detail, hint in _FAILURES:
        if any(sign in message for sign in signs):
            return code, detail, hint
    return "database_unavailable", "The database does not answer at the moment.", _LATER


def is_locked(error: OperationalError) -> bool:
    """Whether the database gave a transaction up because others hold what it wants to change."""
    return _failure_of(error)[0] == _LOCKED


def too_large() -> Problem:
    """A body of more bytes than its route takes."""
    return Problem(
        413, "body_too_large", "The request's body is too large.", "Upload recordings in parts; send less at once."
    )


def install(app: FastAPI) -> None:
    """Answer everything that goes wrong in ``app`` with a problem document."""

    @app.exception_handler(Problem)
    async def on_problem(request: Request, problem: Problem) -> JSONResponse:
        return problem.response()

    @app.exception_handler(DocumentError)
    async def on_document(request: Request, error: DocumentError) -> JSONResponse:
        return unprocessable(error.code, error.message, error.hint, **error.fields).response()

    @app.exception_handler(RequestValidationError)
    async def on_invalid(request: Request, error: RequestValidationError) -> JSONResponse:
        return _of_validation(error.errors()).response()

    @app.exception_handler(HTTPException)
    async def on_http(request: Request, error: HTTPException) -> JSONResponse:
        return _of_status(request, error).response()

    def on_schema(request: Request, error: Exception) -> JSONResponse:
        log.error("%s %s: the schema is not this code's", request.method, request.scope["path"], exc_info=error)
        return schema_mismatch().response()

    @app.exception_handler(ProgrammingError)
    async def on_statement(request: Request, error: ProgrammingError) -> JSONResponse:
        if _is_of_another_schema(error):
            return on_schema(request, error)
        return await on_bug(request, error)

    @app.exception_handler(OperationalError)
    @app.exception_handler(PoolTimeout)
    async def on_database(request: Request, error: Exception) -> JSONResponse:
        if isinstance(error, DBAPIError) and _is_of_another_schema(error):
            return on_schema(request, error)
        code, detail, hint = _failure_of(error)
        trace = None if code == _LOCKED else error
        log.error("%s %s: %s", request.method, request.scope["path"], code, exc_info=trace)
        return Problem(503, code, detail, hint, headers={"Retry-After": "2"}).response()

    @app.exception_handler(IntegrityError)
    async def on_conflict(request: Request, error: IntegrityError) -> JSONResponse:
        log.warning("%s %s: %s", request.method, request.scope["path"], error.orig)
        return conflict(
            "conflict",
            "Somebody made or removed the same thing at this moment; nothing of this request was kept.",
            "Read the present state and send the request again if it still holds.",
        ).response()

    @app.exception_handler(Exception)
    async def on_bug(request: Request, error: Exception) -> JSONResponse:
        # Unexpected errors arrive here last, after what puts the id on answers.
        request_id = request_ids.current()
        log.error("%s %s failed", request.method, request.scope["path"], exc_info=error)
        return Problem(
            500,
            "internal_error",
            "The service failed on this request. The fault is logged, and nothing was changed.",
            "Try again; if it stays, tell whoever runs the service this `request_id`: the log has the details.",
            headers={request_ids.HEADER: request_id} if request_id else None,
            request_id=request_id,
        ).response()


def _of_status(request: Request, error: HTTPException) -> Problem:
    status = error.status_code
    headers = error.headers
    if status == 404:
        return Problem(
            404,
            "no_such_route",
            f"There is nothing at {request.scope['path']}.",
            "/v1/openapi.json lists every address.",
        )
    if status == 405:
        allowed = (headers or {}).get("Allow", "")
        return Problem(
            405,
            "method_not_allowed",
            f"{request.method} is not possible at {request.scope['path']}.",
            f"Possible here: {allowed}." if allowed else "",
            headers=headers,
        )
    if status == 413:
        return too_large()
    phrase = HTTPStatus(status).phrase
    return Problem(status, phrase.lower().replace(" ", "_").replace("-", "_"), str(error.detail), headers=headers)


def _of_validation(errors: Sequence[Any]) -> Problem:
    fields = [_field_error(error) for error in errors[:_MOST_ERRORS]]
    first = fields[0]
    more = f" ({len(errors) - 1} more, in `errors`)" if len(errors) > 1 else ""
    return unprocessable(
        "invalid_request",
        f"{first['field']}: {first['message']}{more}",
        "Correct the fields named in `errors` and send the request again.",
        errors=fields,
    )


def check_query(names: Iterable[str], read: Sequence[str]) -> None:
    """Raises :class:`Problem` 422 ``invalid_request`` where a query names what its route does not read."""
    strange = sorted(set(names) - set(read))
    if not strange:
        return
    errors: list[dict[str, str]] = []
    for name in strange[:_MOST_ERRORS]:
        close = get_close_matches(name, read, 1)
        errors.append({"field": f"query {name}", "message": _unread(close[0] if close else None)})
    raise unprocessable(
        "invalid_request",
        f"{errors[0]['field']}: {errors[0]['message']}",
        f"The query of this address takes: {', '.join(read)}." if read else "This address takes no query.",
        errors=errors,
        known=[*read],
    )


def _unread(close: str | None) -> str:
    return f"is not known here; did you mean `{close}`?" if close else _PLAINLY["extra_forbidden"]


# Our sentences for errors whose own text is about the library, not about the input.
_PLAINLY = {
    "extra_forbidden": "is not known here; check its spelling, or leave it out",
    "uuid_parsing": "is no id; an id looks like 0192f0c1-2d3e-7a4b-8c5d-6e7f8a9b0c1d",
}


def _field_error(error: Mapping[str, Any]) -> dict[str, str]:
    where, *path = error.get("loc", ("request",))
    # pydantic puts the tags of unions between the names; what people wrote has no such step.
    names = [str(step) for step in path if not (isinstance(step, str) and step.startswith("function-"))]
    message = str(error.get("msg", "is not valid")).removeprefix("Value error, ")
    if error.get("type") == "json_invalid":
        return {"field": "body", "message": f"is no JSON: {error.get('ctx', {}).get('error', message)} at {names[0]}"}
    if error.get("type") == "missing" and not names:
        return {"field": str(where), "message": "is missing; send a JSON object with Content-Type: application/json"}
    message = _PLAINLY.get(str(error.get("type")), message)
    if error.get("ctx", {}).get("pattern") == r"^[^\x00]*$":
        message = "holds U+0000, a control character that no text has"
    field = ".".join(names) or str(where)
    return {"field": field if where == "body" else f"{where} {field}", "message": message}
