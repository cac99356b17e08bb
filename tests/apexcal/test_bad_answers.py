"""`apexcal pull` against answers that are no calibration of its vehicle: the kept file stays byte for byte.

Each answer comes from a real HTTP server between the car and the service.
"""

from __future__ import annotations

import gzip
import io
import json
import socketserver
import threading
import time
import zipfile
from base64 import b64encode
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from hashlib import sha256
from http.server import BaseHTTPRequestHandler
from pathlib import Path
from typing import NamedTuple
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import pytest

from tests.support.databases import one_database

pytestmark = one_database

PAGE = b"<!doctype html><title>Sign in to this network</title>"
TRY_AGAIN, FOREIGN = 3, 7


class Answer(NamedTuple):
    """What the server in between sends for a calibration."""

    status: int
    headers: dict[str, str]
    content: bytes
    # Bytes that are announced and never sent.
    missing: int = 0


Change = Callable[[Answer], Answer]


class Between(NamedTuple):
    """The address of the server in between, and what it was asked: path and headers of each request."""

    url: str
    asked: list[tuple[str, dict[str, str]]]


@contextmanager
def between(url: str, change: Change) -> Iterator[Between]:
    """A way to the service on which every answer for a whole vehicle is changed."""
    asked: list[tuple[str, dict[str, str]]] = []

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            asked.append((self.path, dict(self.headers.items())))
            headers = {name: self.headers[name] for name in ("Authorization", "Accept", "If-None-Match")}
            request = Request(url + self.path, headers={name: value for name, value in headers.items() if value})
            try:
                with urlopen(request) as answer:
                    got = Answer(answer.status, dict(answer.headers.items()), answer.read())
            except HTTPError as error:
                got = Answer(error.code, dict(error.headers.items()), error.read())
            if self.path.partition("?")[0].endswith("/calibration"):
                got = change(got)
            self.send_response(got.status)
            for name, value in got.headers.items():
                if name.lower() not in ("content-length", "connection", "date", "server"):
                    self.send_header(name, value)
            self.send_header("Content-Length", str(len(got.content) + got.missing))
            self.end_headers()
            self.wfile.write(got.content)

        def log_message(self, *said):
            pass

    class Server(socketserver.ThreadingTCPServer):
        def handle_error(self, request, client_address):
            """A client leaves in the middle of an answer that is too long."""

    with Server(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True).start()
        yield Between(f"http://127.0.0.1:{server.server_address[1]}", asked)
        server.shutdown()


def digest(content: bytes) -> str:
    return f"sha-256=:{b64encode(sha256(content).digest()).decode()}:"


def resigned(answer: Answer, content: bytes) -> Answer:
    """Other content, with the hash that belongs to it."""
    return answer._replace(content=content, headers=answer.headers | {lower("Repr-Digest", answer): digest(content)})


def lower(name: str, answer: Answer) -> str:
    return next((one for one in answer.headers if one.lower() == name.lower()), name)


def with_header(name: str, value: str) -> Change:
    return lambda answer: answer._replace(headers=answer.headers | {lower(name, answer): value})


def without_header(name: str) -> Change:
    return lambda answer: answer._replace(
        headers={one: value for one, value in answer.headers.items() if one.lower() != name.lower()}
    )


def edited(change: Callable[[dict], object]) -> Change:
    def edit(answer: Answer) -> Answer:
        document = json.loads(answer.content)
        change(document)
        return resigned(answer, json.dumps(document).encode())

    return edit


def flipped(answer: Answer) -> Answer:
    """One bit of one digit of a number."""
    place = answer.content.index(b'"f_x":') + 7
    content = bytearray(answer.content)
    content[place] ^= 1
    json.loads(content)
    return answer._replace(content=bytes(content))


OTHER = "00000000-0000-4000-8000-000000000000"
BAD: dict[str, tuple[Change, int]] = {
    "a page": (lambda answer: Answer(200, {"Content-Type": "text/html"}, PAGE), FOREIGN),
    "a page that names an ETag": (
        lambda answer: answer._replace(headers={"ETag": '"x"', "Content-Type": "text/html"}, content=PAGE), FOREIGN),
    "a captive portal": (
        lambda answer: Answer(302, {"Location": "http://127.0.0.1:9/sign-in"}, b""), FOREIGN),
    "another vehicle": (edited(lambda document: document.update(vehicle_id=OTHER)), FOREIGN),
    "another vehicle's header": (with_header("Apexcal-Vehicle", OTHER), FOREIGN),
    "another alias": (edited(lambda document: document.update(alias="canary")), FOREIGN),
    "another document": (lambda answer: resigned(answer, b'{"cameras": {"front": {}}}'), FOREIGN),
    "cut off": (lambda answer: answer._replace(content=answer.content[:900], missing=100), TRY_AGAIN),
    "cut off by the server in between": (lambda answer: answer._replace(content=answer.content[:900]), FOREIGN),
    "a flipped bit": (flipped, FOREIGN),
    "another media type": (with_header("Content-Type", "text/plain"), FOREIGN),
    "nothing": (lambda answer: resigned(answer, b""), FOREIGN),
    "no hash": (without_header("Repr-Digest"), FOREIGN),
    "another kind of hash": (with_header("Repr-Digest", "md5=:AAAA:"), FOREIGN),
    "no ETag": (without_header("ETag"), FOREIGN),
    "not asked for: unchanged": (lambda answer: Answer(304, {"ETag": '"x"'}, b""), FOREIGN),
    "a part": (lambda answer: answer._replace(status=206), FOREIGN),
    "500": (lambda answer: Answer(500, {"Content-Type": "text/html"}, PAGE), TRY_AGAIN),
    "429": (lambda answer: Answer(429, {"Retry-After": "3600"}, b"{}"), TRY_AGAIN),
    "408": (lambda answer: Answer(408, {"Retry-After": "3600"}, b""), TRY_AGAIN),
    "503": (lambda answer: Answer(503, {"Retry-After": "3600"}, b"{}"), TRY_AGAIN),
    "404 that is no problem": (lambda answer: Answer(404, {"Content-Type": "text/html"}, PAGE), FOREIGN),
    "too long": (lambda answer: resigned(answer, b" " * (17 * 2**20)), FOREIGN),
    "a bomb": (
        lambda answer: answer._replace(
            content=gzip.compress(b" " * 2**26), headers=answer.headers | {"Content-Encoding": "gzip"}),
        FOREIGN),
}  # fmt: skip


def told(result) -> str:
    assert "Traceback" not in result.stderr
    return " ".join(result.stderr.split())


def test_what_comes_unchanged_through_another_server_is_kept(car):
    with between(car.url, lambda answer: answer) as way:
        assert car.pull("--vehicle", str(car.rig.vehicle_id), url=way.url).exit_code == 0
        again = car.pull("--vehicle", str(car.rig.vehicle_id), url=way.url)
    assert again.exit_code == 0 and "has not changed" in again.stderr
    assert all(headers["Accept-Encoding"] == "identity" for _, headers in way.asked)


def test_a_bad_answer_leaves_the_kept_file(car, monkeypatch):
    monkeypatch.setattr(time, "sleep", lambda seconds: None)
    assert car.pull().exit_code == 0
    note = car.file.with_name(".calibration.json.pulled")
    good = car.file.read_bytes(), note.read_bytes()
    car.publish()
    by_id, by_name = ("--vehicle", str(car.rig.vehicle_id)), ("--vehicle", "car")
    for name, (change, exit_code) in BAD.items():
        # Asked for without the file's ETag, so that 304 is no answer.
        words = ("--as-of", "2100-01-01T00:00:00Z") if "unchanged" in name else ()
        with between(car.url, change) as way:
            for by in (by_id, by_name):
                ended = car.pull(*by, *words, "--timeout", "3", url=way.url)
                assert ended.exit_code == exit_code, (name, told(ended))
                assert (car.file.read_bytes(), note.read_bytes()) == good, name
                assert "as it was pulled last" in told(ended), name
    assert sorted(one.name for one in car.file.parent.iterdir()) == [".calibration.json.pulled", "calibration.json"]
    assert car.pull().exit_code == 0 and car.file.read_bytes() != good[0], "what was not damaged is kept"


def test_no_redirect_is_followed_and_no_other_server_gets_the_token(car):
    with (
        between(car.url, lambda answer: answer) as portal,
        between(car.url, lambda answer: Answer(307, {"Location": f"{portal.url}/v1/calibration"}, b"")) as way,
    ):
        ended = car.pull("--vehicle", str(car.rig.vehicle_id), url=way.url)
    assert ended.exit_code == 4 and "leads on to" in told(ended) and portal.asked == []


def test_a_try_again_is_awaited_as_long_as_the_service_says(car, monkeypatch):
    """And not at the same moment by every car."""
    left, waited = [Answer(503, {"Retry-After": "7"}, b"{}"), Answer(429, {}, b"{}")], []
    monkeypatch.setattr(time, "sleep", waited.append)
    with between(car.url, lambda answer: left.pop(0) if left else answer) as way:
        assert car.pull("--vehicle", str(car.rig.vehicle_id), url=way.url).exit_code == 0
    assert len(waited) == 2 and 7.0 <= waited[0] <= 10.5 and 0.3 <= waited[1] <= 0.45
    assert waited[0] != 7.0


def test_a_longer_wait_is_said(car):
    with between(car.url, BAD["503"][0]) as way:
        ended = car.pull("--vehicle", str(car.rig.vehicle_id), url=way.url)
    assert ended.exit_code == 4 and "again in 3600 s" in told(ended) and len(way.asked) == 1


@pytest.mark.parametrize("host", ["http://192.0.2.7", "http://apexcal.example.org:8000", "http://localhost.example"])
def test_a_token_goes_over_http_to_this_machine_alone(car, host, monkeypatch):
    ended = car.pull("--timeout", "0.1", url=host)
    assert ended.exit_code == 2 and "APEXCAL_INSECURE_HTTP" in told(ended)
    monkeypatch.setenv("APEXCAL_INSECURE_HTTP", "1")
    monkeypatch.setattr(time, "sleep", lambda seconds: None)
    assert car.pull("--timeout", "0.1", url=host).exit_code == 4, "no answer, but it was asked"


def zipped(**files: bytes) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return packed.getvalue()


def damaged(content: bytes) -> bytes:
    """The archive with a byte of its first file's content turned over; the service's hash is of these bytes."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        first = archive.infolist()[0]
    place = first.header_offset + 30 + len(first.filename) + 5
    return content[:place] + bytes([content[place] ^ 0xFF]) + content[place + 1 :]


BAD_ARCHIVES = {
    "climbs": lambda content: zipped(**{"../../etc/passwd": b"x"}),
    "absolute": lambda content: zipped(**{"/etc/passwd": b"x"}),
    "backslash": lambda content: zipped(**{"..\\x": b"x"}),
    "file and folder": lambda content: zipped(**{"x": b"x", "x/y": b"x"}),
    "no archive": lambda content: b"PK, but no archive",
    "damaged": damaged,
    "bomb": lambda content: zipped(x=b"0" * (65 * 2**20)),
    "empty": lambda content: zipped(),
}


def files_of(folder: Path) -> dict[str, bytes]:
    return {str(one.relative_to(folder)): one.read_bytes() for one in folder.rglob("*") if one.is_file()}


def test_a_bad_archive_leaves_the_kept_folder(car):
    folder = car.file.parent / "ros2"
    words = ("--vehicle", str(car.rig.vehicle_id), "--format", "ros2", "--unpack", "-o", str(folder))
    assert car.pull(*words).exit_code == 0
    good, there = files_of(folder), folder.readlink()
    assert len(good) >= 3
    car.publish()
    for name, change in BAD_ARCHIVES.items():
        with between(car.url, lambda answer, change=change: resigned(answer, change(answer.content))) as way:
            ended = car.pull(*words, url=way.url)
        assert ended.exit_code == FOREIGN, (name, told(ended))
        assert files_of(folder) == good and folder.readlink() == there, name
    assert not (car.file.parent.parent / "etc").exists()


def test_an_unpacked_folder_is_whole_at_every_moment(car):
    """Replaced by one step, mended when it was changed; the one before stays for who reads it."""
    folder = car.file.parent / "kitti"
    words = ("--vehicle", str(car.rig.vehicle_id), "--format", "kitti", "--unpack", "-o", str(folder))
    assert car.pull(*words).exit_code == 0
    first, good = folder.resolve(), files_of(folder)
    assert "has not changed" in car.pull(*words).stderr and folder.resolve() == first
    next(one for one in folder.rglob("*.txt")).write_text("R: 1")
    (folder / "more").write_text("x")
    assert car.pull(*words).exit_code == 0 and files_of(folder) == good and folder.resolve() != first
    assert first.is_dir() and len(list(folder.parent.glob(".kitti.*.unpacked"))) == 2
    folder.unlink()
    assert car.pull(*words).exit_code == 0 and files_of(folder) == good
    assert len(list(folder.parent.glob(".kitti.*.unpacked"))) == 1


def test_what_unpack_cannot_do_is_said(car):
    folder = car.file.parent / "mine"
    words = ("--vehicle", str(car.rig.vehicle_id), "--unpack", "-o", str(folder))
    one_file = car.pull(*words, "--format", "kalibr")
    assert one_file.exit_code == 2 and "several files" in told(one_file) and not folder.exists()
    folder.mkdir()
    assert car.pull(*words, "--format", "kitti").exit_code == 2, "a folder of somebody"
    assert list(folder.iterdir()) == []
