"""A browser and S3: parts go from the page into the store, frames come from it, and nothing forbids that."""

import os
import re
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import Browser, Request, expect

from apexcal.client import Client
from tests.e2e.conftest import WEB
from tests.support.s3 import S3Server
from tests.support.served import serving
from tests.support.uploads import RIG
from tests.workers.readers.making_recordings import clouds, images, interleaved, png, write_bag

pytestmark = pytest.mark.slow

FORBIDDEN = re.compile("Content Security|CORS|Mixed Content")


@pytest.fixture
def on_s3(tmp_path: Path, s3_server: S3Server) -> Iterator[Client]:
    """`apexcal serve` with its blobs on S3; the owner's client."""
    assert WEB.exists(), "the pages are not built: run `make frontend`"
    settings = s3_server.environment(s3_server.make_bucket()) | {"APEXCAL_DOWNLOADS": "presigned"}
    with (
        serving(tmp_path / "data", "--workers", "1", environment={**os.environ, **settings}) as embedded,
        Client(embedded.url, embedded.token) as owner,
    ):
        yield owner


def test_a_page_uploads_into_the_store_and_shows_frames_from_it(
    browser: Browser, on_s3: Client, s3_server: S3Server, tmp_path: Path
) -> None:
    fleet = on_s3.fleets.create("Track")
    vehicle = on_s3.vehicles.create(fleet.id, "Van 7")
    on_s3.vehicles.create_rig(vehicle.id, RIG)
    picture = images(data=png(*RIG["cameras"][0]["image_size"]))
    bag = write_bag(tmp_path / "walk.bag", interleaved(clouds(), picture))
    complaints: list[str] = []
    asked: list[tuple[str, str, str]] = []

    def note(request: Request) -> None:
        where = urlsplit(request.url)
        asked.append((request.method, f"{where.scheme}://{where.netloc}", where.path))

    context = browser.new_context(viewport={"width": 1280, "height": 800})
    context.set_default_timeout(30_000)
    page = context.new_page()
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("console", lambda said: complaints.append(said.text) if FORBIDDEN.search(said.text) else None)
    page.on("request", note)
    page.goto(on_s3.fleets.invite(fleet.id, "Ines", "engineer").link)
    page.get_by_role("button", name="Sign in").click()
    page.get_by_role("link", name="Van 7").click()
    page.get_by_label("Recording", exact=True).set_input_files(bag)
    page.get_by_role("button", name="Upload").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("walk.bag")
    shown = page.get_by_alt_text("Frame 0 of front")
    expect(shown).to_be_visible()
    assert shown.evaluate("image => [image.src.slice(0, 5), image.naturalWidth]") == ["blob:", 1280]
    to_store = [(method, path) for method, origin, path in asked if origin == s3_server.endpoint]
    assert any(method == "PUT" and "/parts/1/" in path for method, path in to_store)
    assert any(method == "GET" and path.endswith(".mcap") for method, path in to_store)
    assert not any(method == "PUT" and origin == on_s3.base_url for method, origin, _ in asked)
    assert complaints == []
    context.close()
