"""Checks the origin of edits that carry a cookie, because browsers send cookies by themselves."""

from __future__ import annotations

from urllib.parse import urlsplit

from fastapi import Request

from service.platform.http.problems import forbidden

_SAFE = frozenset(("GET", "HEAD", "OPTIONS"))
_LOOPBACK = frozenset(("127.0.0.1", "localhost", "::1"))


def check_origin(request: Request, public_url: str, *, must_name: bool = True) -> None:
    """Raises :class:`Problem` 403 where an unsafe request names a foreign host or comes from a foreign page.

    The host must be the public one or a loopback one (else a rebound DNS name would do), the origin that same
    host or the public one. A request that names no origin is refused with ``must_name``: every browser names it.
    """
    if request.method in _SAFE:
        return
    public = _origin(public_url)
    host = request.headers.get("host", "")
    if host.lower() != urlsplit(public).netloc and _host_name(host) not in _LOOPBACK:
        raise forbidden(
            "host_refused",
            f"The service is not known by the name {host!r}.",
            f"Open it at {public_url}, or start it with the --public-url that people use.",
        )
    origin = request.headers.get("origin")
    if origin is None and not must_name:
        return
    if origin is None or _origin(origin) not in {public, f"http://{host.lower()}", f"https://{host.lower()}"}:
        raise forbidden(
            "origin_refused",
            f"A page of {origin or 'an unnamed origin'} may not act for the signed-in person.",
            f"Use the service's own pages at {public_url}; programs send an API token, or Origin: {public}.",
        )


def _host_name(host: str) -> str | None:
    try:
        return urlsplit(f"//{host}").hostname
    except ValueError:  # an unclosed bracket
        return None


def _origin(url: str) -> str:
    try:
        parts = urlsplit(url)
    except ValueError:
        return ""
    return f"{parts.scheme}://{parts.netloc}".lower()
