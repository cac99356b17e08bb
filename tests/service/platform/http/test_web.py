"""The built pages are sent in the smallest form that a browser takes."""

from pathlib import Path

import pytest

from service.platform.http.web import Pages
from tests.support.databases import one_database
from tests.support.people import Api

pytestmark = one_database

PLAIN = b"let pages = 1;" * 50


@pytest.fixture
def built(api: Api, tmp_path: Path) -> Api:
    """A service whose pages are a page without compressed forms, and a script with both."""
    assets = tmp_path / "assets"
    assets.mkdir()
    (tmp_path / "index.html").write_text("<p>pages</p>")
    (assets / "app-1a2b.js").write_bytes(PLAIN)
    (assets / "app-1a2b.js.br").write_bytes(b"as brotli")
    (assets / "app-1a2b.js.gz").write_bytes(b"as gzip")
    api.app.router.default = Pages(tmp_path)
    return api


def asked(
    api: Api, encodings: str, path: str = "/assets/app-1a2b.js", method: str = "GET", accept: str = "*/*"
) -> tuple[dict, bytes]:
    with api.client.stream(method, path, headers={"Accept-Encoding": encodings, "Accept": accept}) as answer:
        assert answer.status_code == 200
        return dict(answer.headers), b"".join(answer.iter_raw())


@pytest.mark.parametrize(
    ("encodings", "body"),
    [
        ("gzip, deflate, br, zstd", b"as brotli"),
        ("gzip, deflate", b"as gzip"),
        ("br;q=0, GZIP;q=0.5", b"as gzip"),
        ("br; q=0.000, gzip; q=0", PLAIN),
        ("identity", PLAIN),
        ("", PLAIN),
    ],
)
def test_a_script_is_sent_as_the_browser_takes_it(built: Api, encodings: str, body: bytes) -> None:
    headers, sent = asked(built, encodings)
    assert sent == body and int(headers["content-length"]) == len(body)
    assert headers.get("content-encoding") == {b"as brotli": "br", b"as gzip": "gzip"}.get(body)
    assert headers["vary"] == "Accept-Encoding"
    assert "javascript" in headers["content-type"] and "immutable" in headers["cache-control"]
    assert asked(built, encodings, method="HEAD")[0]["content-length"] == headers["content-length"]


def test_each_form_has_its_own_etag(built: Api) -> None:
    assert len({asked(built, encodings)[0]["etag"] for encodings in ("br", "gzip", "identity")}) == 3


def test_what_has_no_compressed_form_is_sent_as_it_is(built: Api) -> None:
    headers, sent = asked(built, "br, gzip", "/recordings/7", accept="text/html,*/*;q=0.8")
    assert sent == b"<p>pages</p>" and "content-encoding" not in headers
    assert headers["vary"] == "Accept, Accept-Encoding" and headers["cache-control"] == "no-cache"


def test_the_compressed_forms_have_no_addresses_of_their_own(built: Api) -> None:
    assert built.client.get("/assets/app-1a2b.js.br").status_code == 404


@pytest.mark.parametrize("accept", ["", "*/*", "application/json", "text/html;q=0, application/json"])
@pytest.mark.parametrize("path", ["/", "/recordings/7", "/calibration.json"])
def test_a_page_is_no_answer_to_a_program(built: Api, path: str, accept: str) -> None:
    answer = built.client.get(path, headers={"Accept": accept})
    assert (answer.status_code, answer.json()["code"]) == (404, "no_such_route")


@pytest.mark.parametrize("path", ["/v1", "/v1/nothing", "/apexcal/v1/me", "/a/b/v1/vehicles/1/calibration"])
@pytest.mark.parametrize("accept", ["text/html", "*/*"])
def test_an_address_of_the_api_is_never_a_page(built: Api, path: str, accept: str) -> None:
    answer = built.client.get(path, headers={"Accept": accept})
    assert (answer.status_code, answer.json()["code"]) == (404, "no_such_route")
