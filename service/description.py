"""Parts of the API's description that FastAPI does not derive: credentials, headers, refusals, words, examples."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from itertools import chain
from pathlib import Path
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
_UNITS: Final = {
    "px": "pixels", "deg": "degrees", "rad": "radians", "m": "metres", "mm": "millimetres",
    "ns": "nanoseconds", "us": "microseconds", "ms": "milliseconds", "s": "seconds",
}  # fmt: skip
_EXAMPLES: Final = {
    "uuid": "7c9e6679-7425-40de-944b-e07fc1f90ae7",
    "date-time": "2026-11-27T08:30:00Z",
    "camera": "front",
    "name": "truck-7",
    "frame": "front_optical",
    "to_frame": "front_optical",
    "from_frame": "lidar",
    "code": "locked",
    "sha256": "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855",
    "reservation": "0f8fad5bd9cb469fa16570867728950e",
}
"""Texts by their format, or by the name of their member."""
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
    words = tomllib.loads(Path(__file__).with_name("members.toml").read_text("utf-8"))
    for name, schema in parts["schemas"].items():
        _describe_members(name, schema, words)
        schema["examples"] = [example(schema, parts["schemas"])]
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
        for parameter in operation.get("parameters", []):
            parameter.setdefault("description", words.get(parameter["name"], ""))
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


def _describe_members(document: str, schema: Json, words: Mapping[str, str]) -> None:
    """Give each member the sentences of its document that name it, else its line of ``members.toml`` and its unit."""
    sentences = _SENTENCE_ENDS.split(" ".join(schema.get("description", "").split()))
    for name, member in schema.get("properties", {}).items():
        named = " ".join(sentence for sentence in sentences if f"``{name}``" in sentence)
        unit = _UNITS.get(name.rpartition("_")[2], "") if "_" in name else ""
        line = words.get(f"{document}.{name}", words.get(name, ""))
        member.setdefault("description", named or ", ".join(filter(None, (line, unit))))


def example(schema: Json, schemas: Mapping[str, Json], name: str = "", inside: tuple[str, ...] = ()) -> Any:
    """Return a value that the schema takes. ``inside``: documents around it, which it does not enter again.

    A schema's own example counts first. A member without one is left out if it may be, and is null or empty then.
    """
    if examples := schema.get("examples"):
        return examples[0]
    if "$ref" in schema:
        document = schema["$ref"].rpartition("/")[2]
        return example(schemas[document], schemas, name, (*inside, document))
    if schema.get("default") not in (None, [], {}):
        return schema["default"]
    if "const" in schema or "enum" in schema:
        return schema.get("const", schema.get("enum", [None])[0])
    if choices := schema.get("anyOf", schema.get("oneOf")):
        return example(next(choice for choice in choices if not _is_around(choice, inside)), schemas, name, inside)
    kind = schema.get("type")
    if kind == "object":
        members = schema.get("properties", {})
        required = schema.get("required", [])
        values = {
            member: example(of, schemas, member, inside)
            for member, of in members.items()
            if member in required or of.get("examples") or not (_is_empty(of) or _is_around(of, inside))
        }
        others = schema.get("additionalProperties")
        key = example(schema.get("propertyNames", {"type": "string"}), schemas, "camera", inside)
        return {key: example(others, schemas, name, inside)} if isinstance(others, dict) and not members else values
    if kind == "array":
        items = schema.get("prefixItems") or [schema.get("items", {})] * max(schema.get("minItems", 1), 1)
        return [example(item, schemas, name, inside) for item in items]
    if kind in ("number", "integer"):
        least = schema.get("minimum", schema.get("exclusiveMinimum", -1) + 1)
        return max(least, min(1, schema.get("maximum", 1))) if kind == "integer" else float(max(least, 0.5))
    if kind == "string":
        return _EXAMPLES.get(schema.get("format", ""), _EXAMPLES.get(name, name or "text"))
    return kind == "boolean"


def _is_empty(schema: Json) -> bool:
    kinds = {schema.get("type"), *(choice.get("type") for choice in schema.get("anyOf", []))}
    return bool(kinds & {"null", "array", "object"})


def _is_around(schema: Json, inside: tuple[str, ...]) -> bool:
    return schema.get("items", schema).get("$ref", "").rpartition("/")[2] in inside


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
