"""`apexcal pull` for cars with older systems: Python 3.8 or newer and its standard library, nothing else.

`apexcal pull` runs this module, and `apexcal pull --program` writes it and those that it imports into one file.
"""

from __future__ import annotations

import argparse
import base64
import hashlib
import http.client
import json
import os
import random
import re
import ssl
import sys
import time
import urllib.error
import urllib.request
import uuid
from email.utils import parsedate_to_datetime
from pathlib import Path
from typing import Any, NoReturn
from urllib.parse import quote, urlencode, urlsplit

from apexcal.archives import read_archive
from apexcal.kept_file import KeptFile, replace_folder

FAILED, USAGE, UNREACHABLE, NOTHING_KEPT, WITHDRAWN, OTHER_SENSORS, FOREIGN = 1, 2, 3, 4, 5, 6, 7
REFUSED = {
    "calibration_withdrawn": WITHDRAWN,
    "calibration_deleted": WITHDRAWN,
    "calibration_does_not_apply": OTHER_SENSORS,
}
# Of every client of ours: apexcal.transport takes these from here.
PAUSES_S = (0.1, 0.3, 1.0, 2.0, 4.0, 8.0, 8.0)
BUSY = (408, 429, 502, 503, 504)
# A longer wait is the caller's to decide.
LONGEST_WAIT_S = 30.0
# The export of a vehicle of 100 cameras has less than 1 MB.
LONGEST_ANSWER = 16 * 2**20
_INPUT_CODES = ("invalid_request", "invalid_options", "unknown_format")
_EXIT_CODES = (
    "Exit codes: 0 the file is current; 1 the service refused, or the file cannot be written; "
    "2 wrong usage; 3 no answer now: try again; 5 the calibration was withdrawn or deleted; 6 it is of other sensors "
    "than the mounted ones; 7 what answered is no calibration of this vehicle. After 1, 3, 5, 6 and 7 the last good "
    "file stays. 4: as these, but there is no good file."
)


class PullError(Exception):
    """Why the file is not what the vehicle is given now: a sentence, what to do, and the exit code."""

    def __init__(self, sentence: str, hint: str = "", code: int = FAILED) -> None:
        super().__init__(sentence)
        self.hint = hint
        self.code = code


class _NoRedirect(urllib.request.HTTPRedirectHandler):
    """Follows no redirect: the token is for one server."""

    def redirect_request(self, req: Any, fp: Any, code: int, msg: str, headers: Any, newurl: str) -> None:
        """Answer with the redirect itself."""


class Service:
    """GET requests to one service, each repeated while it is away or busy.

    ``trust`` holds the authorities whose certificates are believed; None: those of the system.
    """

    def __init__(self, url: str, token: str, timeout_s: float, trust: ssl.SSLContext | None = None) -> None:
        try:
            parts = urlsplit(url)
            is_address = parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port != 0
        except ValueError:
            parts, is_address = urlsplit(""), False
        if not is_address:
            raise PullError(f"{url!r} is no address of a service", "Give it with --url or APEXCAL_URL", USAGE)
        if not re.fullmatch(r"[!-~]+", token):
            raise PullError("no token, or none that can be one", "Give it with --token or APEXCAL_TOKEN", USAGE)
        is_here = re.fullmatch(r"localhost|::1|127\.\d+\.\d+\.\d+", parts.hostname or "") is not None
        is_allowed = os.environ.get("APEXCAL_INSECURE_HTTP", "") not in ("", "0")
        if parts.scheme == "http" and not (is_here or is_allowed):
            raise PullError(
                f"a token for {parts.netloc} would go over http, where others on the way can read it",
                "Give an https address, or allow it in a network that you trust: APEXCAL_INSECURE_HTTP=1",
                USAGE,
            )
        self.url = url.rstrip("/")
        self._headers = {"Authorization": f"Bearer {token}", "Accept-Encoding": "identity"}
        self._timeout_s = timeout_s
        self._was_reached = False
        # A proxy of the environment would read over http what is meant for this machine alone.
        proxies = urllib.request.ProxyHandler(None if parts.scheme == "https" or is_allowed else {})
        self._opener = urllib.request.build_opener(_NoRedirect, proxies, urllib.request.HTTPSHandler(context=trust))

    def get(self, path: str, query: dict[str, Any], etag: str | None = None) -> tuple[int, Any, bytes]:
        """Return status (200 or 304), headers and content of an answer. Raises :class:`PullError`."""
        headers = dict(self._headers, Accept="application/json", **({"If-None-Match": etag} if etag else {}))
        words = urlencode({name: value for name, value in query.items() if value}, doseq=True)
        request = urllib.request.Request(f"{self.url}/v1{path}?{words}".rstrip("?"), headers=headers)
        pauses_s = PAUSES_S if self._was_reached else PAUSES_S[:2]
        for pause_s in (*pauses_s, None):
            wait_s = 0.0
            try:
                status, answered, content = self._read(request)
            except (OSError, http.client.HTTPException) as error:
                if pause_s is None:
                    reason = getattr(error, "reason", None) or error
                    raise PullError(f"no answer from {self.url}: {reason}", code=UNREACHABLE) from None
            else:
                self._was_reached = True
                if status in (200, 304):
                    return status, answered, content
                wait_s = retry_after_s(answered)
                if status not in BUSY or pause_s is None or wait_s > LONGEST_WAIT_S:
                    raise self._problem(status, answered, content)
            # Spread, so that a fleet does not come back at one moment.
            time.sleep(max(pause_s or 0.0, wait_s) * random.uniform(1.0, 1.5))
        raise AssertionError("the last pause is None")

    def _read(self, request: urllib.request.Request) -> tuple[int, Any, bytes]:
        """One request. Raises OSError, HTTPException, :class:`PullError`."""
        try:
            answer = self._opener.open(request, timeout=self._timeout_s)
        except urllib.error.HTTPError as error:
            answer = error
        with answer:
            content = bytearray()
            for piece in iter(lambda: answer.read(2**16), b""):
                content += piece
                if len(content) > LONGEST_ANSWER:
                    raise self.foreign(f"answered more than {LONGEST_ANSWER} bytes")
            status, headers = int(answer.code), answer.headers
        if headers.get("Content-Encoding", "identity") != "identity":
            raise self.foreign("answered compressed bytes")
        length = headers.get("Content-Length", "")
        if status != 304 and length.isdigit() and int(length) != len(content):
            raise http.client.IncompleteRead(bytes(content), int(length) - len(content))
        return status, headers, bytes(content)

    def _problem(self, status: int, headers: Any, content: bytes) -> PullError:
        """What a refusal means: it may pass, it says why, or another program refused."""
        if 300 <= status < 400 and headers.get("Location"):
            return self.foreign(f"leads on to {headers['Location']}, which is not followed")
        try:
            fields = json.loads(content)
        except ValueError:
            fields = None
        is_problem = isinstance(fields, dict)
        fields = fields if is_problem else {"detail": f"{self.url} answered {status}"}
        name, wait_s = str(fields.get("code") or "unknown"), retry_after_s(headers)
        code = REFUSED.get(name, USAGE if name in _INPUT_CODES else FAILED)
        if status >= 500 or status in BUSY:
            code = UNREACHABLE
        elif status < 400 or not is_problem:
            code = FOREIGN
        hint = str(fields.get("hint") or "") + (f" Ask again in {wait_s:.0f} s." if wait_s else "")
        detail = str(fields.get("detail") or f"the service answered {status}").rstrip(".")
        return PullError(f"{detail} ({name})", hint.strip(), code)

    def foreign(self, what: str) -> PullError:
        """The error of an answer that is not this service's."""
        return PullError(
            f"{self.url} {what}",
            "Is this the address of an apexcal service, its prefix too, and does a proxy or the sign-in page of a "
            "network answer in its place?",
            FOREIGN,
        )

    def only_vehicle(self, fleet: str) -> str:
        """Return the id of the only vehicle that the token may see. Raises :class:`PullError`."""
        fleets = [each["id"] for each in self._items("/fleets") if fleet in ("", each["id"], each["name"])]
        vehicles = [each for fleet_id in fleets for each in self._items(f"/fleets/{fleet_id}/vehicles")]
        if len(vehicles) != 1:
            names = ", ".join(repr(each["name"]) for each in vehicles[:20])
            raise PullError(f"there are {len(vehicles)} vehicles: {names}", "Say which one with --vehicle", USAGE)
        return str(vehicles[0]["id"])

    def _items(self, path: str) -> list[Any]:
        items: list[Any] = []
        after = None
        while True:
            try:
                page = json.loads(self.get(path, {"limit": 100, "after": after})[2])
                items += [{"id": str(each["id"]), "name": str(each["name"])} for each in page["items"]]
                after = page.get("next")
            except (ValueError, KeyError, TypeError, AttributeError):
                raise self.foreign("answered what is no list") from None
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
            raise PullError(f"{output} is no place for a {what}", "Name a new one in a folder that exists", USAGE)
        service = Service(options.url, options.token, options.timeout, trust)
        is_changed = _pull(service, pulled, options)
        if options.unpack:
            replace_folder(output, read_archive(pulled.path.read_bytes()))
    except PullError as error:
        _leave(error, pulled)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        _leave(PullError(f"cannot write {error.filename or 'the file'}: {reason}"), pulled)
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
    status, headers, content = service.get(path, query, etag)
    if status == 304 and etag:
        return False
    _check(service, headers if status == 200 else {}, content, options, vehicle_id)
    if options.unpack:
        if not content.startswith(b"PK"):
            raise PullError("--unpack is for a format of several files", "Leave it out for this format", USAGE)
        try:
            read_archive(content)
        except ValueError as error:
            raise service.foreign(f"answered what {error}") from None
    pulled.replace(content, headers["ETag"], query_key)
    return True


def _check(service: Service, headers: Any, content: bytes, options: argparse.Namespace, vehicle_id: str) -> None:
    """Raise :class:`PullError` for what is no whole calibration of this vehicle in this format and of this alias."""
    is_json = options.format == "json"
    media_type = "application/json" if is_json else f"application/vnd.apexcal.{options.format}+"
    sha256 = base64.b64encode(hashlib.sha256(content).digest()).decode()
    if not headers.get("ETag") or not headers.get("Content-Type", "").startswith(media_type):
        raise service.foreign(f"answered what is no {media_type.rstrip('+')}")
    if headers.get("Repr-Digest") != f"sha-256=:{sha256}:":
        raise service.foreign("answered bytes without their SHA-256 (Repr-Digest)")
    named = {headers.get("Apexcal-Vehicle"), vehicle_id or headers.get("Apexcal-Vehicle")}
    if is_json:
        try:
            document = json.loads(content)
            is_whole = all(each["result_id"] and each["T_camera_lidar"] for each in document["cameras"].values())
            named.add(document["vehicle_id"] if is_whole and document["alias"] == options.alias else None)
        except (ValueError, KeyError, TypeError, AttributeError):
            raise service.foreign("answered something else than a vehicle's calibration") from None
    if len(named) > 1 or None in named:
        raise service.foreign("answered another vehicle's calibration, or another alias")


def _leave(error: PullError, pulled: KeptFile) -> NoReturn:
    """Say what is wrong and which file there is, and exit."""
    _say(f"apexcal: {str(error).rstrip('.')}.")
    if error.hint:
        _say(f"{error.hint.rstrip('.')}.")
    code = error.code
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


def retry_after_s(headers: Any) -> float:
    """Seconds that the answer asks to wait: a number or a date (RFC 9110, 10.2.3); 0 where it asks for none."""
    after = headers.get("Retry-After") or ""
    try:
        seconds = float(after) if after.isdigit() else parsedate_to_datetime(after).timestamp() - time.time()
    except (ValueError, TypeError):  # TypeError until Python 3.9
        return 0.0
    return max(seconds, 0.0)


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
