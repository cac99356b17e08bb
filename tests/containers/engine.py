"""A Docker engine and Docker Compose: those of the machine, or, as root on Debian, an engine of our own.

Our own engine runs in a mount namespace with a single hierarchy of cgroups and sets up no firewall, so it isolates
networks less than a usual one. It runs in a process namespace too, so nothing of it outlives its end, whatever hangs
in it. It reaches no registry of images; `local_images` makes what stands in for them.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

_PACKAGES = ("docker.io", "runc", "iptables", "debootstrap", "ca-certificates")
_START_S = 60
_STOP_S = 60
# cgroup v2 beside v1 is refused by the runtime. Images are in memory where there is room: a disk that discards each
# freed block removes a container's files in minutes.
_IN_NAMESPACE = """
mount --make-rprivate /
umount /sys/fs/cgroup/unified 2>/dev/null
if [ "$(awk '/^MemAvailable/ {print $2}' /proc/meminfo)" -gt 12000000 ]; then mount -t tmpfs -o size=9g tmpfs "$1"; fi
shift
# This shell is the first process of its namespace and collects those that others leave behind.
"$@"
exit $?
"""


class NoEngineError(Exception):
    """No engine runs here and none can be started; the text says why."""


@dataclass(frozen=True)
class Engine:
    """Docker as commands see it. ``is_ours``: official images cannot be pulled."""

    environment: Mapping[str, str]
    is_ours: bool

    def docker(self, *words: str, timeout_s: float = 600, stdin: bytes | None = None) -> str:
        """What `docker WORDS` prints. Raises CalledProcessError with what it said."""
        done = subprocess.run(
            ["docker", *words], env=dict(self.environment), capture_output=True, timeout=timeout_s, input=stdin
        )
        if done.returncode:
            sys.stderr.write(done.stdout.decode() + done.stderr.decode())
            done.check_returncode()
        return done.stdout.decode()


@contextmanager
def engine(folder: Path) -> Iterator[Engine]:
    """The machine's engine, or our own with all its data below ``folder``. Raises :class:`NoEngineError`."""
    if _answers(os.environ) and _has_compose(os.environ):
        yield Engine(dict(os.environ), is_ours=False)
        return
    _install()
    with _own_engine(folder) as environment:
        yield Engine(environment, is_ours=True)


def _answers(environment: Mapping[str, str]) -> bool:
    return shutil.which("docker") is not None and _succeeds(["docker", "info"], environment)


def _has_compose(environment: Mapping[str, str]) -> bool:
    return _succeeds(["docker", "compose", "version"], environment)


def _succeeds(command: list[str], environment: Mapping[str, str]) -> bool:
    return subprocess.run(command, env=dict(environment), capture_output=True).returncode == 0


def _install() -> None:
    """Debian's packages, where they are missing."""
    if shutil.which("dockerd") and shutil.which("runc") and shutil.which("debootstrap"):
        return
    if os.getuid() != 0 or not Path("/etc/debian_version").exists():
        raise NoEngineError(
            "no Docker engine with Compose answers here. Install Docker, or run this as root on Debian, where it "
            "installs and starts an engine of its own"
        )
    quiet = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    # What a package's own start of a service prints is no matter: nothing of it is used.
    for words in (["update", "-qq"], ["install", "-qq", "--yes", "--no-install-recommends", *_PACKAGES]):
        done = subprocess.run(["apt-get", *words], env=quiet, capture_output=True, text=True)
        if done.returncode:
            raise NoEngineError(f"apt-get {words[0]} failed: {done.stderr.strip()[-400:]}")


@contextmanager
def _own_engine(folder: Path) -> Iterator[dict[str, str]]:
    data = folder / "data"
    data.mkdir(parents=True, exist_ok=True)
    # A socket's path has 107 characters at most.
    run = Path(f"/run/apexcal-containers-{os.getpid()}")
    run.mkdir(mode=0o700)
    command = [
        *("dockerd", "--iptables=false", "--ip6tables=false", "--bridge=none", "--storage-driver=overlay2"),
        *("--data-root", str(data), "--exec-root", str(run / "exec"), "--pidfile", str(run / "pid")),
        *("--host", f"unix://{run}/docker.sock"),
    ]
    namespaces = ["unshare", "--mount", "--pid", "--mount-proc", "--fork", "--kill-child"]
    environment = {**os.environ, "DOCKER_HOST": f"unix://{run}/docker.sock", "DOCKER_CONFIG": str(_client(folder))}
    # The classic builder: Debian has no buildx.
    environment["DOCKER_BUILDKIT"] = "0"
    # It does not see that services share an image, unless the one is built before the other.
    environment["COMPOSE_PARALLEL_LIMIT"] = "1"
    with (folder / "dockerd.log").open("w") as log:
        child = subprocess.Popen(
            [*namespaces, "sh", "-c", _IN_NAMESPACE, "sh", str(data), *command],
            stdout=log,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
    try:
        _wait_until_ready(child, environment, folder / "dockerd.log")
        yield environment
    finally:
        # With the first process of their namespace the kernel ends all others.
        child.kill()
        child.wait(_STOP_S)
        shutil.rmtree(run, ignore_errors=True)


def _client(folder: Path) -> Path:
    """A folder of Docker's client with Compose as its plugin."""
    spec = find_spec("compose")
    if spec is None or spec.origin is None:
        raise NoEngineError("Docker Compose is not installed: run `make compose-test`")
    plugins = folder / "client" / "cli-plugins"
    plugins.mkdir(parents=True, exist_ok=True)
    plugin = plugins / "docker-compose"
    plugin.unlink(missing_ok=True)
    plugin.symlink_to(Path(spec.origin).parent / "docker-compose")
    return plugins.parent


def _wait_until_ready(child: subprocess.Popen[bytes], environment: Mapping[str, str], log: Path) -> None:
    until = time.monotonic() + _START_S
    while not _answers(environment):
        if child.poll() is not None or time.monotonic() > until:
            last = "\n".join(log.read_text().splitlines()[-3:])
            raise NoEngineError(f"the Docker engine did not start: {last}")
        time.sleep(0.5)
