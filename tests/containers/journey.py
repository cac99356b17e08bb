"""docker-compose.yml as a newcomer starts it and an operator runs it: `make compose-test`.

One journey in the order of docs/operators.md, in a copy of the checkout, by the commands that are written there. Its
seconds and sizes are printed; what each command said is in `var/containers/commands.log`.
"""

from __future__ import annotations

import os
import secrets
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple, TypeVar
from uuid import UUID

import httpx
import pytest
from playwright.sync_api import expect, sync_playwright

from apexcal.client import Client
from apexcal.documents.calibrations import CalibrationView
from apexcal.processes import kill_session
from apexcal.regions import read_region
from apexcal.rigs import read_rig
from benchmarks.demo.annotators import mark_everything
from benchmarks.demo.truth import Truth
from tests.containers import local_images
from tests.containers.engine import Engine, NoEngineError, engine
from tests.e2e.chromium import find_chromium
from tests.support.places import ROOT

FOLDER = ROOT / "var" / "containers"
NO_ENGINE = FOLDER / "no-engine"
LOG = FOLDER / "commands.log"
PROJECT = "apexcal-test"
URL = "https://localhost"
ROOT_CERTIFICATE = "/data/caddy/pki/authorities/local/root.crt"
SECONDS = 10
QUICK = {"slots": 2, "population": 300, "generations": 20, "max_iterations": 3}
# A loaded machine may need this long for what an idle one does in a tenth of it.
PATIENCE_S = 600
WORKERS = ("worker-ingest", "worker-detect", "worker-solve", "worker-report")
RUNNING = ("api", "api-2", "sweeper", *WORKERS, "proxy", "postgres", "valkey", "store", "s3")
T = TypeVar("T")

# A command has PATIENCE_S; the first test builds all images too.
pytestmark = pytest.mark.timeout(3 * PATIENCE_S)


class Published(NamedTuple):
    """What the journey published: the camera's vehicle and its calibration's address, and a token to ask with."""

    vehicle_id: UUID
    etag: str
    body: bytes


class Compose:
    """A copy of the checkout with its containers, and the seconds that each step took."""

    def __init__(self, folder: Path, engine: Engine) -> None:
        self.folder, self.engine = folder, engine
        self.environment = dict(engine.environment) | {"COMPOSE_PROJECT_NAME": PROJECT}
        self.began = 0.0

    def run(self, command: str) -> str:
        """What a command of the manual prints, as it is written there."""
        done = self._outcome(command)
        with LOG.open("a") as log:
            log.write(f"$ {command}\n{done.stdout}{done.stderr}\n")
        said = "\n".join((done.stdout + done.stderr).splitlines()[-30:])
        assert done.returncode == 0, f"{command}: {self.state()}\n{said}"
        return done.stdout.strip()

    def fails(self, command: str) -> str:
        """What a command says that must fail."""
        done = self._outcome(command)
        assert done.returncode != 0, f"{command} did not fail: {done.stdout}"
        return done.stdout + done.stderr

    def measure(self, name: str, step: Callable[[], T]) -> T:
        """The step's result; its seconds go into the figures."""
        began = time.monotonic()
        result = step()
        self.note(f"{name}, s", f"{time.monotonic() - began:.0f}")
        return result

    def note(self, name: str, value: str) -> None:
        """A figure, said at once."""
        print(f"{name}: {value}", flush=True)

    def state(self) -> str:
        """What each container does, and the last lines of those that ended badly."""
        listed = self._ask("docker compose ps --all --format '{{.Service}} {{.Status}}'")
        return listed + self._ask("docker compose logs --no-color --tail 12")

    def is_healthy(self, service: str) -> bool:
        """What its health check says, of every container of the service."""
        states = self._ask(f"docker compose ps {service} --format '{{{{.Health}}}}'").split()
        return bool(states) and set(states) == {"healthy"}

    def trust(self) -> None:
        """Let clients of this process trust the proxy's own authority."""
        certificate = self.folder / "root.crt"
        self.run(f"docker compose cp proxy:{ROOT_CERTIFICATE} root.crt")
        os.environ["SSL_CERT_FILE"] = str(certificate)

    def _ask(self, command: str) -> str:
        return self._outcome(command).stdout

    def _outcome(self, command: str) -> subprocess.CompletedProcess[str]:
        """The ended command. One that hangs is killed with all that it started, and fails the test."""
        child = subprocess.Popen(
            command,
            shell=True,
            cwd=self.folder,
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        try:
            stdout, stderr = child.communicate(timeout=PATIENCE_S)
        except subprocess.TimeoutExpired:
            kill_session(child.pid)
            raise AssertionError(f"{command} did not end within {PATIENCE_S} s: {child.communicate()}") from None
        return subprocess.CompletedProcess(command, child.returncode, stdout, stderr)


@pytest.fixture(scope="module")
def compose() -> Iterator[Compose]:
    """The copy, with an engine; at the end no container, volume or network of it is left."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    for file in (NO_ENGINE, LOG):
        file.unlink(missing_ok=True)
    try:
        with engine(FOLDER / "engine") as running:
            yield from _in_copy(running)
    except NoEngineError as error:
        NO_ENGINE.write_text(f"docker-compose.yml was not tried in containers: {error}.\n")
        pytest.skip(str(error))


def _in_copy(running: Engine) -> Iterator[Compose]:
    copy = FOLDER / "checkout"
    shutil.rmtree(copy, ignore_errors=True)
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        check=True,
        text=True,
    )
    for name in filter(None, listed.stdout.split("\0")):
        if (ROOT / name).is_file():
            (copy / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, copy / name)
    compose = Compose(copy, running)
    if running.is_ours:
        compose.measure("stand-ins for official images", lambda: local_images.build(running, FOLDER))
        (copy / "Dockerfile.local").write_text(local_images.localised((ROOT / "Dockerfile").read_text()))
        shutil.copy(local_images.OVERRIDE, copy / "local-images.yml")
        compose.environment["COMPOSE_FILE"] = "docker-compose.yml:local-images.yml"
    try:
        yield compose
    finally:
        if not running.is_ours:  # all of ours ends with it
            compose.run("docker compose --profile backup down --volumes --remove-orphans --timeout 20")


def wait_until(is_so: Callable[[], bool], what: str, compose: Compose) -> None:
    """Look every second until it is so."""
    until = time.monotonic() + PATIENCE_S
    while not is_so():
        assert time.monotonic() < until, f"no {what}: {compose.state()}"
        time.sleep(1.0)


def answers(path: str = "/readyz") -> bool:
    """Whether the proxy brings an answer of an API."""
    try:
        return httpx.get(f"{URL}{path}", timeout=10).is_success
    except httpx.TransportError:
        return False


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated recording."""
    folder = tmp_path_factory.mktemp("walk") / "walk"
    command = [
        sys.executable,
        "-m",
        "workers.simulation",
        "--out",
        str(folder),
        "--seconds",
        str(SECONDS),
        "--camera-info",
        "raw",
    ]
    subprocess.run(command, check=True, capture_output=True)
    return folder


@pytest.fixture(scope="module")
def started(compose: Compose, walk: Path) -> Compose:
    """The whole fleet, up from empty volumes by what README says."""
    compose.run("make env")
    compose.measure("images built", lambda: compose.run("docker compose --profile backup build"))
    for image in ("apexcal-serve:1.0.0", "apexcal-worker:1.0.0"):
        size = int(compose.engine.docker("image", "inspect", "--format", "{{.Size}}", image))
        compose.note(f"{image}, MB", f"{size / 1e6:.0f}")
    compose.began = began = time.monotonic()
    compose.run("docker compose up --build -d")
    compose.note("containers started, s", f"{time.monotonic() - began:.0f}")
    wait_until(lambda: compose.is_healthy("proxy"), "healthy proxy", compose)
    compose.trust()
    wait_until(answers, "answer through the proxy", compose)
    compose.note("first answer through the proxy, s", f"{time.monotonic() - began:.0f}")
    return compose


@pytest.fixture(scope="module")
def owner(started: Compose) -> Iterator[Client]:
    """Signed in by the owner's link."""
    link = started.run("docker compose run --rm api python -m service.platform.auth.bootstrap").splitlines()[-1]
    with Client.sign_in(link) as client:
        started.note("first sign-in, s", f"{time.monotonic() - started.began:.0f}")
        yield client


@pytest.fixture(scope="module")
def calibrated(started: Compose, owner: Client, walk: Path) -> tuple[CalibrationView, Published]:
    """From the upload to a published calibration, with three invited people and farmed slots."""
    began = time.monotonic()
    trucks = owner.fleets.create("Trucks")
    vehicle = owner.vehicles.create(trucks.id, "Truck 7")
    rig = owner.vehicles.create_rig(vehicle.id, read_rig(walk / "rig.json", "front"))
    upload = owner.recordings.upload(walk / "recording.bag", vehicle.id, rig.id)
    recording = owner.wait(upload, timeout_s=PATIENCE_S)
    started.note("recording read, s after the sign-in", f"{time.monotonic() - began:.0f}")
    region = read_region(walk / "region.json")
    detection = owner.wait(owner.detections.create(recording.id, region, detector="tolerant"), timeout_s=PATIENCE_S)
    mark_everything(owner, trucks.id, detection, "front", Truth(walk / "truth.json"), lambda share, message: None)
    pairs = owner.correspondence_sets.build(detection.id, "front")
    calibration = owner.wait(
        owner.calibrations.create(vehicle.id, [pairs.id], ["pinhole"], folds=0, farm="slots", schedule=QUICK),
        timeout_s=PATIENCE_S,
    )
    started.note("first calibration, s after the sign-in", f"{time.monotonic() - began:.0f}")
    result_id = calibration.summary.cameras["front"].models["pinhole"].result_id
    owner.calibrations.publish(result_id, "ten seconds of walking are enough to try the fleet", override=True)
    answer = ask(owner, vehicle.id)
    return calibration, Published(vehicle.id, answer.headers["etag"], answer.content)


def ask(client: Client, vehicle_id: UUID, **headers: str) -> httpx.Response:
    """A car's question."""
    return client._http.send("GET", f"/vehicles/{vehicle_id}/cameras/front/calibration", headers=headers)


def test_a_browser_uploads_on_localhost(started: Compose, owner: Client, walk: Path) -> None:
    """Who has accepted the page's certificate is asked for no other: parts go through the API."""
    link = started.run("docker compose run --rm api python -m service.platform.auth.bootstrap").splitlines()[-1]
    chromium = find_chromium()
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=chromium.executable, env=dict(chromium.environment), args=["--no-sandbox"]
        )
        page = browser.new_context(ignore_https_errors=True).new_page()
        asked: set[str] = set()
        page.on("request", lambda request: asked.add(str(httpx.URL(request.url).host)))
        page.goto(link)
        page.get_by_role("button", name="Sign in").click()
        page.get_by_label("Recording and URDF").set_input_files([walk / "recording.bag", walk / "vehicle.urdf"])
        expect(page.get_by_role("heading", level=1)).to_have_text("recording.bag", timeout=60_000)
        card = page.get_by_role("region", name="Rig")
        expect(card).to_contain_text("as the URDF says", timeout=PATIENCE_S * 1000)
        assert asked - {""} == {"localhost"}
        browser.close()


def test_a_newcomer_gets_from_two_commands_to_a_calibration(
    started: Compose, owner: Client, calibrated: tuple[CalibrationView, Published]
) -> None:
    calibration, published = calibrated
    assert calibration.summary.cameras["front"].models["pinhole"].polished.rms_px < 30
    assert ask(owner, published.vehicle_id, **{"If-None-Match": published.etag}).status_code == 304
    page = httpx.get(URL, headers={"Accept": "text/html"}).text
    assert "<script" in page and httpx.get(f"{URL}/docs/operators.html").is_success
    result_id = calibration.summary.cameras["front"].models["pinhole"].result_id
    report = owner.wait(owner.analyses.report(result_id), timeout_s=PATIENCE_S)
    assert b"<html" in owner.analyses.read_file(report.id)[:200]


def test_every_part_is_healthy_and_says_so(started: Compose, calibrated: Any) -> None:
    for service in RUNNING:
        wait_until(lambda service=service: started.is_healthy(service), f"healthy {service}", started)
    token = dict(line.split("=", 1) for line in (started.folder / ".env").read_text().splitlines())
    headers = {"Authorization": f"Bearer {token['APEXCAL_METRICS_TOKEN']}"}
    parts = [
        line for line in httpx.get(f"{URL}/metrics", headers=headers).text.splitlines() if "apexcal_part_up{" in line
    ]
    assert parts and all(line.endswith((" 1", " 1.0")) for line in parts), parts


def test_a_second_worker_takes_work(started: Compose, owner: Client, calibrated: Any) -> None:
    started.run("docker compose up -d --no-recreate --scale worker-solve=2")
    wait_until(lambda: started.is_healthy("worker-solve"), "two healthy workers", started)
    assert len(started.run("docker compose ps worker-solve --quiet").splitlines()) == 2


def test_both_apis_are_replaced_while_cars_ask(
    started: Compose, owner: Client, calibrated: tuple[CalibrationView, Published]
) -> None:
    published = calibrated[1]
    stopping, statuses = threading.Event(), []

    def poll() -> None:
        while not stopping.is_set():
            statuses.append(ask(owner, published.vehicle_id).status_code)
            time.sleep(0.05)

    car = threading.Thread(target=poll)
    car.start()
    try:
        for name in ("api", "api-2"):
            started.run(f"docker compose up -d --no-deps --force-recreate {name}")
            wait_until(lambda name=name: started.is_healthy(name), f"healthy {name}", started)
    finally:
        stopping.set()
        car.join()
    started.note("answers to cars during the replacement", f"{len(statuses)}, {set(statuses)}")
    assert set(statuses) == {200}


def test_a_backup_brings_everything_back_into_empty_volumes(
    started: Compose, owner: Client, calibrated: tuple[CalibrationView, Published]
) -> None:
    published = calibrated[1]
    started.measure("backup", lambda: started.run("docker compose run --rm backup"))
    (backup,) = [path.name for path in (started.folder / "backups").iterdir()]
    started.run("docker compose down --volumes")
    left = started.engine.docker("volume", "ls", "--quiet", "--filter", f"label=com.docker.compose.project={PROJECT}")
    assert left == ""
    started.measure("restore", lambda: started.run(f"docker compose run --rm restore {backup}"))
    started.run("docker compose up --build -d")
    wait_until(lambda: started.is_healthy("proxy"), "healthy proxy", started)
    started.trust()
    wait_until(answers, "answer through the proxy", started)
    link = started.run("docker compose run --rm api python -m service.platform.auth.bootstrap").splitlines()[-1]
    with Client.sign_in(link) as again:
        answer = ask(again, published.vehicle_id)
        assert (answer.content, answer.headers["etag"]) == (published.body, published.etag)


def test_every_secret_can_be_changed(started: Compose, calibrated: tuple[CalibrationView, Published]) -> None:
    lines = (started.folder / ".env").read_text().splitlines()
    old = dict(line.split("=", 1) for line in lines)
    new = old | {name: secrets.token_hex(24) for name in old if not name.startswith("APEXCAL_") or "TOKEN" in name}
    (started.folder / ".env").write_text("".join(f"{name}={value}\n" for name, value in new.items()))
    change = f"ALTER ROLE apexcal PASSWORD '{new['POSTGRES_PASSWORD']}'"
    started.run(f'docker compose exec postgres psql --username apexcal --command "{change}"')
    (started.folder / "store-identities.json").unlink()
    started.run("make env")
    started.measure(
        "new secrets", lambda: started.run("docker compose up -d --force-recreate s3 && docker compose up -d")
    )
    wait_until(lambda: started.is_healthy("proxy"), "healthy proxy", started)
    wait_until(answers, "answer through the proxy", started)
    link = started.run("docker compose run --rm api python -m service.platform.auth.bootstrap").splitlines()[-1]
    with Client.sign_in(link) as again:
        assert ask(again, calibrated[1].vehicle_id).headers["etag"] == calibrated[1].etag
    for names, role in (
        *(("POSTGRES_PASSWORD", "apexcal"), ("API_DATABASE_PASSWORD", "apexcal_api")),
        *(("WORKER_DATABASE_PASSWORD", "apexcal_worker"), ("INGEST_DATABASE_PASSWORD", "apexcal_ingest")),
    ):
        login = f"postgresql://{role}:{old[names]}@postgres/apexcal"
        probe = f"import psycopg; psycopg.connect('{login}')"
        refused = started.fails(f'docker compose run --rm api python -c "{probe}"')
        assert "password authentication failed" in refused, refused
    parts = httpx.get(f"{URL}/readyz").json()["parts"]
    assert all(part["ok"] for part in parts.values()), parts


def test_it_stops_and_what_it_holds_is_there_again(
    started: Compose, calibrated: tuple[CalibrationView, Published]
) -> None:
    for service in RUNNING:
        wait_until(lambda service=service: started.is_healthy(service), f"healthy {service}", started)
    started.measure("stop", lambda: started.run("docker compose stop"))
    codes = started.run("docker compose ps --all --format '{{.Service}} {{.ExitCode}}'").splitlines()
    killed = [line for line in codes if line.endswith(" 137")]
    assert not killed, f"{killed}: {started.state()}"
    started.run("docker compose up -d")
    wait_until(lambda: started.is_healthy("proxy"), "healthy proxy", started)
    wait_until(answers, "answer through the proxy", started)
    # A backup reads every object that a row names, and compares its digest.
    started.run("docker compose run --rm backup")
