"""Requests with everything that every request needs: sign-in, retries, idempotency keys, problems as exceptions."""

from __future__ import annotations

import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, TypedDict, TypeVar, Unpack
from urllib.parse import quote

import httpx
from pydantic import BaseModel, ValidationError

from apexcal.documents.base import Page, first_fault, not_finite
from apexcal.errors import ApiError, ForeignAnswerError, InputError, TokenError, UnreachableError
from apexcal.http_rules import (
    PAUSES_S,
    ask_again,
    check_document,
    is_token,
    may_leave,
    problem_of,
    read_whole,
    refuse_redirect,
    split_address,
)

Document = dict[str, Any]
M = TypeVar("M", bound=BaseModel)

# A part of 16 MiB over a slow line takes minutes; everything else answers at once.
TIMEOUT = httpx.Timeout(60.0, connect=5.0, write=300.0)


class RequestParts(TypedDict, total=False):
    """What a request carries besides its address; None is as what is left out."""

    params: Mapping[str, Any] | None
    json: Any
    content: bytes | None
    headers: Mapping[str, str] | None


class HttpTransport:
    """Speaks JSON over HTTP with one service. Safe to share between threads."""

    def __init__(
        self,
        base_url: str,
        token: str | None = None,
        pauses_s: tuple[float, ...] = PAUSES_S,
        timeout_s: float | None = None,
    ) -> None:
        parts = split_address(base_url)
        if parts is None:
            raise ValueError(f"{base_url!r} is no address of a service; it looks like http://127.0.0.1:8000")
        self.base_url = f"{parts.scheme}://{parts.netloc}{parts.path.rstrip('/')}"
        self._pauses_s = pauses_s
        self._reached = False
        # A signed-in session is a cookie, and unsafe methods with cookies must name where they come from.
        headers = {"Accept": "application/json", "Origin": f"{parts.scheme}://{parts.netloc}"}
        if token:
            if not is_token(token):
                raise TokenError("the given text")
            headers["Authorization"] = f"Bearer {token}"
        proxies, address = may_leave(parts), self.base_url + "/v1"
        self._http = httpx.Client(base_url=address, headers=headers, timeout=timeout_s or TIMEOUT, trust_env=proxies)

    def close(self) -> None:
        """Close the connections."""
        self._http.close()

    def get(self, path: str, kind: type[M], /, **query: Any) -> M:
        """GET a document of this kind. ``None`` values of the query are left out."""
        return read(self.send("GET", path, params=without_none(query)), kind)

    def items(self, path: str, kind: type[M], /, **query: Any) -> Iterator[M]:
        """Every item of a paged list, page after page."""
        query["limit"] = query.get("limit") or 100
        while True:
            page = self.get(path, Page[kind], **query)
            yield from page.items
            if not page.next:
                return
            query["after"] = page.next

    def post(self, path: str, kind: type[M], body: Any = None, *, key: str | None = None) -> M:
        """POST a JSON document.

        A key makes a repetition harmless: the service answers a repeated key with its first answer. It is made up
        when none is given, so a request that is sent again after a lost connection never creates twice.
        """
        return read(self.create(path, json=body, key=key), kind)

    def create(self, path: str, *, key: str | None = None, **request: Unpack[RequestParts]) -> httpx.Response:
        """POST anything, with an idempotency key as of :meth:`post`."""
        request["headers"] = {**(request.get("headers") or {}), "Idempotency-Key": key or str(uuid.uuid4())}
        return self.send("POST", path, **request)

    def patch(self, path: str, kind: type[M], body: Any, *, version: int | None = None) -> M:
        """Edit this version of a row; :class:`ApiError` ``version_conflict`` where it has changed meanwhile."""
        headers = None if version is None else if_match(version)
        return read(self.send("PATCH", path, json=body, headers=headers), kind)

    def put(self, path: str, kind: type[M], body: Any, headers: Mapping[str, str] | None = None) -> M:
        """PUT a JSON document."""
        return read(self.send("PUT", path, json=body, headers=headers), kind)

    def get_export(self, path: str, format: str, **query: Any) -> httpx.Response:
        """GET a calibration in a format of another program.

        Raises ForeignAnswerError unless it is a whole answer in that format, with the SHA-256 that it states.
        """
        params = without_none({"format": format, **query})
        identity = {"Accept-Encoding": "identity"}
        response = self.send("GET", path, params=params, headers=identity, is_limited=True)
        check_document(response.request.url, response, f"application/vnd.apexcal.{format}+")
        return response

    def delete(self, path: str, **query: Any) -> None:
        """DELETE; nothing is answered."""
        self.send("DELETE", path, params=without_none(query))

    def send(
        self, method: str, path: str, *, is_limited: bool = False, **request: Unpack[RequestParts]
    ) -> httpx.Response:
        """One request, tried again while the service is away or busy. No redirect is followed.

        Raises ApiError, ForeignAnswerError, InputError, UnreachableError. ``is_limited``: a longer answer than
        `LONGEST_ANSWER`, or a compressed one, is foreign. Every request of this client may be repeated: reads and
        deletes by nature, parts by their digest, edits by their version, creations by their key.
        """
        strange = not_finite(request.get("json"))
        if strange is not None:
            raise InputError(f"{strange or 'what would be sent'} is not a finite number", "JSON has no such numbers.")
        parts = without_none(request)

        def ask() -> httpx.Response:
            with self._http.stream(method, path, **parts) as streamed:
                self._reached = True
                if not is_limited:
                    streamed.read()
                    return streamed
                status, headers, sent = streamed.status_code, streamed.headers, streamed.request
                content = read_whole(sent.url, headers, streamed.iter_raw())
                return httpx.Response(status, headers=headers, content=content, request=sent)

        try:
            # A service that never answered is more likely misspelt than restarting.
            pauses_s = self._pauses_s if self._reached else self._pauses_s[:2]
            response: httpx.Response = ask_again(ask, (httpx.TransportError,), pauses_s)
        except httpx.TransportError as error:
            raise self._unreachable(error) from error
        refuse_redirect(response.request.url, response)
        if response.status_code >= 400:
            raise _refusal(response)
        return response

    @contextmanager
    def stream(self, path: str) -> Iterator[httpx.Response]:
        """GET bytes as a stream. Raises ApiError, UnreachableError."""
        try:
            with self._http.stream("GET", path, headers={"Accept": "*/*"}) as response:
                if response.status_code >= 400:
                    response.read()
                    raise _refusal(response)
                yield response
        except httpx.TransportError as error:
            raise self._unreachable(error) from error

    def _unreachable(self, error: httpx.TransportError) -> UnreachableError:
        reason = str(error).rstrip(".") or type(error).__name__
        return UnreachableError(
            f"no answer from {self.base_url}: {reason}",
            "Is the service running (`apexcal serve`), and is the address right (--url or APEXCAL_URL)?",
        )


class Resource:
    """Methods for the things of one kind, over a client's transport."""

    def __init__(self, transport: HttpTransport) -> None:
        self._http = transport


def read(response: httpx.Response, kind: type[M]) -> M:
    """The answer as a document of this kind; what a newer service says besides stays in it. Raises ClientError."""
    try:
        return kind.model_validate_json(response.content, extra="allow")
    except ValidationError as error:
        where, wrong = first_fault(error)
        what = f"answered something else than this client knows: {where}: {wrong}"
        raise ForeignAnswerError(response.request.url, what) from None


def at(*segments: object) -> str:
    """The path of these segments, each quoted: what is no id stays one segment, and leads nowhere else."""
    # Dots are quoted by hand: quote() leaves them, and a segment of dots alone would climb.
    quoted = (quote(str(segment), safe="", errors="replace") for segment in segments)
    return "".join("/" + (part.replace(".", "%2E") if part in (".", "..") else part) for part in quoted)


def if_match(version: int) -> dict[str, str]:
    """The header of an edit of this version of the row."""
    return {"If-Match": f'"v{version}"'}


def _refusal(response: httpx.Response) -> ApiError:
    sentence = f"{response.request.url} answered {response.status_code} {response.reason_phrase}"
    hint = "Is this the address of an apexcal service?"
    return problem_of(response, {"code": "not_a_problem_document", "detail": sentence, "hint": hint})


def without_none(query: Mapping[str, Any]) -> dict[str, Any]:
    """The members that are not None."""
    return {name: value for name, value in query.items() if value is not None}
