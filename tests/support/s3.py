"""A real S3 server out of the `moto` wheel, in a process of its own; every store gets a bucket of its own."""

import itertools
import os
import shutil
import signal
import sys
import tempfile
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import httpx
from pydantic import SecretStr

from service.platform.settings import S3Options
from service.platform.storage.prepare import prepare
from service.platform.storage.store import Store
from tests.support.networks import Host
from tests.support.processes import free_port, start, stop, wait_until

_numbers = itertools.count(1)


class S3Server:
    """Buckets live in its memory: stopping it loses them, pausing it does not. It may be on a ``host``."""

    def __init__(self, address: str = "127.0.0.1", host: Host | None = None) -> None:
        self.address = address = host.address if host else address
        self.folder = Path(tempfile.mkdtemp(prefix="apexcal-s3-"))
        self.port = free_port()
        command = [sys.executable, "-m", "moto.server", "-H", address, "-p", str(self.port)]
        with host.inside() if host else nullcontext():
            self.child = start(command, self.folder / "log")
        wait_until(self._answers, "the start of the S3 server")

    @property
    def endpoint(self) -> str:
        """Its address, as in ``APEXCAL_S3_ENDPOINT``."""
        return f"http://{self.address}:{self.port}"

    def options(self, **changed: object) -> S3Options:
        """How to reach it. It takes any keys, but some there must be."""
        given = {"endpoint": self.endpoint, "access_key_id": "apexcal", "secret_access_key": "secret"}
        return S3Options(**(given | changed))

    def settings(self, bucket: str) -> dict[str, Any]:
        """Settings of a service that keeps its blobs in this bucket."""
        return {
            "blob_url": f"s3://{bucket}/blobs",
            "s3_endpoint": self.endpoint,
            "s3_access_key_id": "apexcal",
            "s3_secret_access_key": SecretStr("secret"),
        }

    def environment(self, bucket: str) -> dict[str, str]:
        """The same as environment variables."""
        plain = self.settings(bucket) | {"s3_secret_access_key": "secret"}
        return {f"APEXCAL_{name.upper()}": value for name, value in plain.items()}

    def make_bucket(self) -> str:
        """A fresh bucket's name."""
        name = f"bucket-{next(_numbers)}"
        assert prepare(f"s3://{name}", self.options())
        return name

    def store(self, **changed: object) -> Store:
        """A store on a fresh bucket; its options can be ``changed``."""
        return Store(f"s3://{self.make_bucket()}/some/prefix", self.options(**changed))

    def pause(self) -> None:
        """Let it hang: connections are taken and never answered."""
        os.kill(self.child.pid, signal.SIGSTOP)

    def resume(self) -> None:
        """Let it go on."""
        os.kill(self.child.pid, signal.SIGCONT)

    def close(self) -> None:
        """Stop it and remove its folder."""
        self.resume()
        stop(self.child)
        shutil.rmtree(self.folder, ignore_errors=True)

    def _answers(self) -> bool:
        assert self.child.poll() is None, (self.folder / "log").read_text()
        try:
            return httpx.get(f"{self.endpoint}/moto-api/", timeout=2).status_code == 200
        except httpx.TransportError:
            return False
