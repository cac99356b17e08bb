"""`apexcal pull` for cars with older systems: Python 3.8 or newer and its standard library, nothing else.

`apexcal pull` runs this module, and `apexcal pull --program` writes it and those that it imports into one file.
"""

from __future__ import annotations

import argparse
import http.client
import json
import os
import ssl
import sys
import urllib.error
import urllib.request
import uuid
from pathlib import Path
from typing import Any, NamedTuple, NoReturn
from urllib.parse import quote, urlencode

from apexcal.archives import read_archive
from apexcal.errors import ApiError, ClientError, ForeignAnswerError, InputError, UnreachableError, as_sentence
from apexcal.http_rules import (
    BUSY,
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
from apexcal.kept_file import KeptFile, replace_folder

FAILED, USAGE, UNREACHABLE, NOTHING_KEPT, WITHDRAWN, OTHER_SENSORS, FOREIGN = 1, 2, 3, 4, 5, 6, 7
REFUSED = {
    "calibration_withdrawn": WITHDRAWN,
    "calibration_deleted": WITHDRAWN,
    "calibration_does_not_apply": OTHER_SENSORS,
}
# What is no problem document has this one.
_NO_CODE = "unknown"
_EXIT_CODES = (
    "Exit codes: 0 the file is current; 1 the service refused, or the file cannot be written; "
    "2 wrong usage; 3 no answer now: try again; 5 the calibration was withdrawn or deleted; 6 it is of other sensors "
    "than the mounted ones; 7 what answered is no calibration of this vehicle. After 1, 3, 5, 6 and 7 the last good "
    "file stays. 4: as these, but there is no good file."
)


class WholeAnswer(NamedTuple):
    """An answer with its whole content."""

    status_code: int
    headers: Any
    content: bytes


class _NoRedirect(urllib.request.HTTPRedirectHandler):
    """Follows no redirect: the token is for one server."""

    def redirect_request(self, req: Any, fp: Any, code: int, msg: str, headers: Any, newurl: str) -> None:
        """Answer with the redirect itself."""


class Service:
    """GET requests to one service, each repeated while it is away or busy.

    ``trust`` holds the authorities whose certificates are believed; None: those of the system.
    """

    def __init__(self, url: str, token: str, timeout_s: float, trust: ssl.SSLContext | None = None) -> None:
        parts = split_address(url)
        if parts is None:
            raise InputError(f"{url!r} is no address of a service", "Give it with --url or APEXCAL_URL")
        if not is_token(token):
            raise InputError("no token, or none that can be one", "Give it with --token or APEXCAL_TOKEN")
        proxies = urllib.request.ProxyHandler(None if may_leave(parts) else {})
        self.url = url.rstrip("/")
        self._headers = {"Authorization": f"Bearer {token}", "Accept-Encoding": "identity"}
        self._timeout_s = timeout_s
        self._was_reached = False
        self._opener = urllib.request.build_opener(_NoRedirect, proxies, urllib.request.HTTPSHandler(context=trust))

    def get(self, path: str, query: dict[str, Any], etag: str | None = None) -> WholeAnswer:
        """Return an answer of status 200 or 304. Raises :class:`ClientError`."""
        headers = dict(self._headers, Accept="application/json", **({"If-None-Match": etag} if etag else {}))
        words = urlencode({name: value for name, value in query.items() if value}, doseq=True)
        request = urllib.request.Request(f"{self.url}/v1{path}?{words}".rstrip("?"), headers=headers)
        losses = (OSError, http.client.HTTPException)
        try:
            pauses_s = PAUSES_S if self._was_reached else PAUSES_S[:2]
            answer: WholeAnswer = ask_again(lambda: self._read(request), losses, pauses_s)
        except losses as error:
            raise UnreachableError(f"no answer from {self.url}: {getattr(error, 'reason', None) or error}") from None
        if answer.status_code in (200, 304):
            return answer
        refuse_redirect(self.url, answer)
        raise problem_of(answer, {"code": _NO_CODE, "detail": f"{self.url} answered {answer.status_code}"})

    def _read(self, request: urllib.request.Request) -> WholeAnswer:
        """One request. Raises OSError, HTTPException, :class:`ForeignAnswerError`."""
        try:
            answer = self._opener.open(request, timeout=self._timeout_s)
        except urllib.error.HTTPError as error:
            answer = error
        with answer:
            status, headers = int(answer.code), answer.headers
            content = read_whole(self.url, headers, iter(lambda: answer.read(2**16), b""))
        length = headers.get("Content-Length", "")
        if status != 304 and length.isdigit() and int(length) != len(content):
            raise http.client.IncompleteRead(content, int(length) - len(content))
        self._was_reached = True
        return WholeAnswer(status, headers, content)

    def only_vehicle(self, fleet: str) -> str:
        """Return the id of the only vehicle that the token may see. Raises :class:`ClientError`."""
        fleets = [each["id"] for each in self._items("/fleets") if fleet in ("", each["id"], each["name"])]
        vehicles = [each for fleet_id in fleets for each in self._items(f"/fleets/{fleet_id}/vehicles")]
        if len(vehicles) != 1:
            names = ", ".join(repr(each["name"]) for each in vehicles[:20])
            raise InputError(f"there are {len(vehicles)} vehicles: {names}", "Say which one with --vehicle")
        return str(vehicles[0]["id"])

    def _items(self, path: str) -> list[Any]:
        items: list[Any] = []
        after = None
        while True:
            try:
                page = json.loads(self.get(path, {"limit": 100, "after": after}).content)
                items += [{"id": str(each["id"]), "name": str(each["name"])} for each in page["items"]]
                after = page.get("next")
            except (ValueError, KeyError, TypeError, AttributeError):
                raise ForeignAnswerError(self.url, "answered what is no list") from None
            if not after:
                return items


def pull(options: argparse.Namespace, trust: ssl.SSLContext | None = None) -> NoReturn:
    """Pull, say on standard error what came of it, and exit."""
    # A link to a file stays, and what it leads to is replaced. A link to a folder is replaced itself.
    output = Path(options.output)
    output = output.parent.resolve() / output.name if options.unpack else output.resolve()
    pulled = KeptFile(output.with_name(f".{output.name}.zip") if options.unpack else output)
    try:
        fits = output.is_symlink() if options.unpack else output.is_file()
        if (output.exists() and not fits) or not output.parent.is_dir():
            what = "link" if options.unpack else "file"
            raise InputError(f"{output} is no place for a {what}", "Name a new one in a folder that exists")
        service = Service(options.url, options.token, options.timeout, trust)
        is_changed = _pull(service, pulled, options)
        if options.unpack:
            replace_folder(output, read_archive(pulled.path.read_bytes()))
    except ClientError as error:
        _leave(error, pulled)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        _leave(ClientError(f"cannot write {error.filename or 'the file'}: {reason}"), pulled)
    _say(f"{output} {'was replaced' if is_changed else 'has not changed'}.")
    sys.exit(0)


def _pull(service: Service, pulled: KeptFile, options: argparse.Namespace) -> bool:
    """Whether the kept file was replaced, because the service has another content than it."""
    query = {"camera": options.camera, "as_of": options.as_of, "serial": options.serial}
    query["format"] = None if options.format == "json" else options.format
    query["alias"] = None if options.alias == "current" else options.alias
    vehicle = options.vehicle
    if vehicle == options.sensor == "":
        vehicle = service.only_vehicle(options.fleet)
    vehicle_id = _as_id(vehicle)
    if vehicle_id:
        path = f"/vehicles/{quote(vehicle_id, safe='')}/calibration"
    else:
        path = "/calibration"
        query.update(vehicle=vehicle, fleet=options.fleet, sensor=options.sensor)
    query_key = json.dumps([service.url, path, query])
    etag = pulled.etag(query_key)
    answer = service.get(path, query, etag)
    if answer.status_code == 304 and etag:
        return False
    _check(service.url, answer, options, vehicle_id)
    if options.unpack:
        if not answer.content.startswith(b"PK"):
            raise InputError("--unpack is for a format of several files", "Leave it out for this format")
        try:
            read_archive(answer.content)
        except ValueError as error:
            raise ForeignAnswerError(service.url, f"answered what {error}") from None
    pulled.replace(answer.content, answer.headers["ETag"], query_key)
    return True


def _check(url: str, answer: WholeAnswer, options: argparse.Namespace, vehicle_id: str) -> None:
    """Raise ForeignAnswerError for what is no whole calibration of this vehicle in this format and of this alias."""
    is_json = options.format == "json"
    check_document(url, answer, "application/json" if is_json else f"application/vnd.apexcal.{options.format}+")
    named_vehicle = answer.headers.get("Apexcal-Vehicle")
    named = {named_vehicle, vehicle_id or named_vehicle}
    if is_json:
        try:
            document = json.loads(answer.content)
            is_whole = all(each["result_id"] and each["T_camera_lidar"] for each in document["cameras"].values())
            named.add(document["vehicle_id"] if is_whole and document["alias"] == options.alias else None)
        except (ValueError, KeyError, TypeError, AttributeError):
            raise ForeignAnswerError(url, "answered something else than a vehicle's calibration") from None
    if len(named) > 1 or None in named:
        raise ForeignAnswerError(url, "answered another vehicle's calibration, or another alias")


def _exit_code(error: ClientError) -> int:
    if isinstance(error, ApiError):
        if error.status >= 500 or error.status in BUSY:
            return UNREACHABLE
        if error.status < 400 or error.fields.get("code") == _NO_CODE:
            return FOREIGN
        return REFUSED.get(error.code, USAGE if error.is_about_the_input else FAILED)
    codes = {InputError: USAGE, UnreachableError: UNREACHABLE, ForeignAnswerError: FOREIGN}
    return codes.get(type(error), FAILED)


def _leave(error: ClientError, pulled: KeptFile) -> NoReturn:
    """Say what is wrong and which file there is, and exit."""
    reason = f"{error.detail.rstrip('.')} ({error.code})" if isinstance(error, ApiError) else str(error)
    _say(as_sentence(f"apexcal: {reason}"))
    if error.hint:
        _say(as_sentence(error.hint))
    code = _exit_code(error)
    if code != USAGE and pulled.is_whole():
        _say(f"{pulled.path} is as it was pulled last.")
    elif code != USAGE:
        code = NOTHING_KEPT
        _say(f"apexcal: there is no {pulled.path} that was pulled before.")
    sys.exit(code)


def _say(sentence: str) -> None:
    """Print on standard error; what cannot be seen is spelled out, so that no name sends commands to a terminal."""
    print("".join(c if c.isprintable() else json.dumps(c)[1:-1] for c in sentence), file=sys.stderr)


def _as_id(text: str) -> str:
    """The id that this text is, or nothing where it is a name."""
    try:
        return str(uuid.UUID(text))
    except ValueError:
        return ""


def _seconds(text: str) -> float:
    seconds = float(text)
    if not 0.1 <= seconds <= 600.0:
        raise argparse.ArgumentTypeError(f"{text} is not between 0.1 and 600 seconds")
    return seconds


def options_parser(command: str | None = None) -> argparse.ArgumentParser:
    """The parser of the options that :func:`pull` takes. ``command``: what the help calls the program."""
    what = "Keep a vehicle's current calibration in a file. It is replaced whole, or not at all."
    parser = argparse.ArgumentParser(prog=command, description=what, epilog=_EXIT_CODES)
    text = ("vehicle", "id or name"), ("fleet", "its fleet"), ("sensor", "serial number of a sensor of the vehicle")
    for name, help in (*text, ("as-of", "a moment in the past, 2026-03-01T12:00:00Z")):
        parser.add_argument(f"--{name}", default="", help=help)
    parser.add_argument("--output", "-o", required=True, help="the file, or with --unpack the link to the folder")
    parser.add_argument("--camera", action="append", help="only this one; may be repeated")
    parser.add_argument("--serial", action="append", help="NAME=SERIAL of a mounted sensor; may be repeated")
    parser.add_argument("--format", default="json", help="json, or a format of the service")
    parser.add_argument("--alias", default="current", help="the alias to follow")
    parser.add_argument("--unpack", action="store_true", help="keep a folder of the files of --format")
    parser.add_argument("--timeout", type=_seconds, default=10.0, help="seconds to wait for each answer")
    parser.add_argument("--url", default=os.environ.get("APEXCAL_URL", ""), help="address of the service")
    parser.add_argument("--token", default=os.environ.get("APEXCAL_TOKEN", ""), help="API token")
    return parser


if __name__ == "__main__":
    pull(options_parser().parse_args())
