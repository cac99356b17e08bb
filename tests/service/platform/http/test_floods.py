"""One tenant, or a stranger, sends many requests at once: others are answered as before, in memory with a bound."""

import socket
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from urllib.parse import urlsplit

import httpx
import pytest

from service.platform.auth.gate import STRANGER_S, STRANGERS
from tests.service.pairs.test_streamed_views import seed_set
from tests.service.platform.http.conftest import ServedProcess
from tests.support.people import Api

SELECTIONS = 60
# Each selection of 100,000 pairs took 45 MB, and the reader waited for 45 s.
_MOST_MIB = 300.0
_MOST_READ_S = 10.0


def watch(look: Callable[[], object], futures: list[Future[httpx.Response]]) -> list[float]:
    """Seconds of each look, one after the other, until the futures are done."""
    took_s: list[float] = []
    while not took_s or not all(one.done() for one in futures):
        began = time.monotonic()
        look()
        took_s.append(time.monotonic() - began)
    return took_s


@pytest.mark.parametrize("pairs", [20_000, pytest.param(100_000, marks=pytest.mark.slow)])
def test_many_selections_of_a_large_set_hurt_no_reader(api: Api, process: ServedProcess, pairs: int) -> None:
    fleet, elsewhere = api.fleet(), api.fleet()
    path = f"/v1/correspondence-sets/{seed_set(api, fleet, pairs).id}/selections"
    engineer, bystander = api.member(fleet, "engineer"), api.member(elsewhere, "viewer")
    with (
        httpx.Client(base_url=process.url, headers=engineer.headers, timeout=60) as client,
        httpx.Client(base_url=process.url, headers=bystander.headers, timeout=60) as reader,
        ThreadPoolExecutor(SELECTIONS) as pool,
    ):

        def read() -> None:
            assert reader.get(f"/v1/fleets/{elsewhere}/vehicles").status_code == 200

        read()
        before_mib = process.peak_mib()
        posts = [pool.submit(client.post, path, json={"leave_out": [number]}) for number in range(SELECTIONS)]
        looks_s = watch(read, posts)
        statuses = Counter(one.result().status_code for one in posts)
    grown_mib = process.peak_mib() - before_mib
    print(
        f"{pairs} pairs: {statuses}, the reader {max(looks_s):.2f} s, {len(looks_s)} looks, {grown_mib:.0f} MiB more"
    )
    assert set(statuses) <= {201, 503} and statuses[201]
    assert grown_mib < _MOST_MIB and max(looks_s) < _MOST_READ_S


@pytest.mark.parametrize("database_url", ["postgresql"], indirect=True)
@pytest.mark.parametrize("count", [STRANGERS + 36, pytest.param(1050, marks=pytest.mark.slow)])
def test_many_unfinished_sign_ins_end_and_the_service_goes_on(api: Api, process: ServedProcess, count: int) -> None:
    where = urlsplit(process.url)
    unfinished = (
        f"POST /v1/sign-in HTTP/1.1\r\nHost: {where.netloc}\r\nContent-Type: application/json\r\n"
        'Content-Length: 40\r\n\r\n{"link":'
    ).encode()

    def send_and_wait() -> tuple[bytes, float]:
        with socket.create_connection((where.hostname, where.port), timeout=60) as stranger:
            stranger.sendall(unfinished)
            began = time.monotonic()
            try:
                return stranger.recv(12), time.monotonic() - began
            except ConnectionResetError:
                return b"", time.monotonic() - began

    with httpx.Client(base_url=process.url, timeout=60) as client, ThreadPoolExecutor(count) as pool:

        def look() -> None:
            assert client.get("/healthz").status_code == 200

        strangers = [pool.submit(send_and_wait) for _ in range(count)]
        looks_s = watch(look, strangers)
        answers = [one.result() for one in strangers]
    slowest_s = max(seconds for _, seconds in answers)
    statuses = Counter(answer for answer, _ in answers)
    print(f"{count}: {statuses}, ended within {slowest_s:.2f} s; {len(looks_s)} looks, {max(looks_s):.2f} s at most")
    assert set(statuses) <= {b"HTTP/1.1 408", b""} and statuses[b"HTTP/1.1 408"]
    assert slowest_s < 4 * STRANGER_S
    assert max(looks_s) < STRANGER_S
