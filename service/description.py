"""What the API's description says besides what FastAPI derives: credentials, headers and refusals."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from itertools import chain
from typing import Any, Final

from fastapi import FastAPI
from fastapi.dependencies.models import Dependant
from fastapi.routing import APIRoute

from apexcal.documents.base import Document
from service.platform.auth.access import COOKIE, write_access
from service.platform.db.base import Json
from service.platform.http.etags import conditions
from service.platform.http.problems import MEDIA_TYPE
from service.platform.http.router import CREATED, header

_OPEN: Final = frozenset(("sign_in", "healthz.get", "readyz.get"))
"""Operations that need no credentials."""
_SCHEMES: Final[Json] = {
    "token": {"type": "http", "scheme": "bearer", "description": "An API token: `apexcal token` makes one."},
    "session": {
        "type": "apiKey",
        "in": "cookie",
        "name": COOKIE,
        "description": "A browser's session, which a sign-in link starts.",
    },
}
_LOCATION: Final[Json] = {
    "description": "where it is read, and followed if it takes time",
    "schema": {"type": "string"},
}
_SENTENCE_ENDS: Final = re.compile(r"(?<=[.;])\s+(?=[`A-Z])")


class ProblemDocument(Document):
    """A refusal (RFC 9457). ``code`` is stable and made for programs, ``detail`` says what is wrong and where, and
    ``hint`` what to do. Some have further members.
    """

    type: str
    title: str
    status: int
    detail: str
    code: str
    hint: str


def install(app: FastAPI) -> None:
    """Complete the description that ``app`` gives of itself."""
    derived = app.openapi

    def described() -> Json:
        if app.openapi_schema is None:
            _complete(derived(), app)
        return derived()

    app.openapi = described


def _complete(document: Json, app: FastAPI) -> None:
    parts = document["components"]
    parts["securitySchemes"] = _SCHEMES
    for unused in ("HTTPValidationError", "ValidationError"):
        parts["schemas"].pop(unused, None)
    parts["schemas"]["ProblemDocument"] = ProblemDocument.model_json_schema()
    for schema in parts["schemas"].values():
        _describe_members(schema)
    refusal: Json = {
        "description": "a refusal, with what to do",
        "content": {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/ProblemDocument"}}},
    }
    document["security"] = [{name: []} for name in _SCHEMES]
    for operation in chain.from_iterable(path.values() for path in document["paths"].values()):
        operation["responses"].pop("422", None)
        operation["responses"]["default"] = refusal
        if operation["operationId"] in _OPEN:
            operation["security"] = []
    for route in app.routes:
        if isinstance(route, APIRoute) and route.include_in_schema:
            calls = frozenset(_calls(route.dependant))
            for method in route.methods or ():
                if headers := list(_headers(method, route, calls)):
                    operation = document["paths"][route.path_format][method.lower()]
                    operation.setdefault("parameters", []).extend(headers)
                if route.status_code in CREATED:
                    answers = document["paths"][route.path_format][method.lower()]["responses"]
                    answers[str(route.status_code)]["headers"] = {"Location": _LOCATION}


def _describe_members(schema: Json) -> None:
    """Give each member the sentences of its document that name it."""
    sentences = _SENTENCE_ENDS.split(" ".join(schema.get("description", "").split()))
    for name, member in schema.get("properties", {}).items():
        named = " ".join(sentence for sentence in sentences if f"``{name}``" in sentence)
        if named:
            member.setdefault("description", named)


def _calls(dependant: Dependant) -> Iterator[Callable[..., Any] | None]:
    for inner in dependant.dependencies:
        yield inner.call
        yield from _calls(inner)


def _headers(method: str, route: APIRoute, calls: frozenset[Callable[..., Any] | None]) -> Iterator[Json]:
    """The headers that a route reads through what it depends on."""
    # Who cancels twice has cancelled.
    makes = route.status_code in (201, 202) and not route.path_format.endswith("/cancel")
    if method == "POST" and makes and write_access in calls:
        yield header("Idempotency-Key", "The same key and request get the first answer again. A UUID is best.")
    if conditions in calls:
        if method == "GET":
            yield header("If-None-Match", "An ETag that is known: where it still holds, the answer is 304.")
        else:
            yield header("If-Match", "The ETag of the version that is edited.")
