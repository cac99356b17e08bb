"""Gives up, for good, what the reading of an upload does not need: network, processes, files, capabilities.

Each of the three means is the kernel's own, and taken where the kernel allows it to this process:

- namespaces: a network without any interface, and no System V memory of others; in containers the runtime often
  refuses them;
- Landlock: reads the recording and the Python installation, writes its own folders, connects to nothing, signals
  nobody outside;
- seccomp: no sockets, no new programs or processes, no look into other processes; also where Landlock does not reach,
  as with a broker's socket in the file system.

``python -m workers.readers.isolation.isolate`` isolates itself and prints what is in force here.
"""

from __future__ import annotations

import ctypes
import json
import os
import resource
import site
import sys
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from workers.readers.isolation.landlock import restrict_files
from workers.readers.isolation.seccomp import refuse_calls

_PR_SET_DUMPABLE: Final = 4
_PR_SET_NO_NEW_PRIVS: Final = 38
_CLONE_NEWIPC: Final = 0x08000000
_CLONE_NEWUSER: Final = 0x10000000
_CLONE_NEWNET: Final = 0x40000000
# FFmpeg converts a picture with as many threads as there are processors.
_MOST_THREADS: Final = 256
_CAPABILITY_VERSION: Final = 0x20080522
# Our own packages that reading imports.
_PACKAGES: Final = tuple(Path(__file__).parents[3] / name for name in ("workers", "apexcal"))
# Shared libraries and what they look at when they are loaded.
_SYSTEM: Final = (
    *("/usr", "/lib", "/lib64", "/nix/store", "/etc/ld.so.cache", "/etc/localtime", "/dev/urandom", "/dev/zero"),
    *("/sys/devices/system/cpu", "/proc/cpuinfo", "/proc/meminfo", "/proc/self"),
)


@dataclass(frozen=True, slots=True)
class Isolation:
    """The means of isolation that are in force.

    Attributes:
        no_new_privs: no program that it could start would have more rights.
        namespaces: it has a network of its own, without interfaces.
        landlock: version of Landlock's interface; 0: files are not restricted.
        seccomp: whether calls are refused.
    """

    no_new_privs: bool
    namespaces: bool
    landlock: int
    seccomp: bool

    def __str__(self) -> str:
        files = f"Landlock {self.landlock}" if self.landlock else "no Landlock: files of this user are open to it"
        calls = "seccomp" if self.seccomp else "no seccomp (libseccomp.so.2 is missing, or the kernel refuses)"
        network = "a network of its own" if self.namespaces else "no network namespace (refused)"
        return f"{files}; {calls}; {network}"


def isolate(readable: Iterable[Path], writable: Iterable[Path]) -> Isolation:
    """Isolate this process, which must have one thread; there is no way back.

    Args:
        readable: files and folders that stay readable, besides the Python installation.
        writable: folders in which anything may be done.
    """
    if sys.platform != "linux":
        return Isolation(False, False, 0, False)
    libc = ctypes.CDLL(None, use_errno=True)
    no_new_privs = libc.prctl(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0
    # Without privileges only a new user namespace may make the others; root may be refused that one but not these.
    others = _CLONE_NEWNET | _CLONE_NEWIPC
    own_users = libc.unshare(_CLONE_NEWUSER | others) == 0
    namespaces = own_users or libc.unshare(others) == 0
    if own_users:  # counted there alone; elsewhere it would count all that its user runs
        resource.setrlimit(resource.RLIMIT_NPROC, (_MOST_THREADS, _MOST_THREADS))
    _drop_capabilities(libc)
    landlock = restrict_files([*_installation(), *readable], writable)
    return Isolation(no_new_privs, namespaces, landlock, refuse_calls())


def hide_from_others() -> None:
    """Make this process's memory and environment unreadable for other processes of its user.

    It prevents core dumps, and tracing by others than root. It does not outlive an ``exec``; a fork keeps it.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_DUMPABLE, 0, 0, 0, 0)


def _drop_capabilities(libc: ctypes.CDLL) -> None:
    """Drop all capabilities: a new user namespace gives all of them, root has them, and none is needed."""
    header = (ctypes.c_uint32 * 2)(_CAPABILITY_VERSION, 0)
    libc.capset(header, (ctypes.c_uint32 * 6)())


def _installation() -> Sequence[Path]:
    """Return the folders of Python and its packages, without a checkout's: a service's data may lie in that."""
    prefixes = [Path(prefix) for prefix in {sys.prefix, sys.base_prefix, sys.exec_prefix}]
    packages = [Path(entry) for entry in sys.path if Path(entry).name in ("site-packages", "dist-packages")]
    libraries = [Path(entry) for entry in os.environ.get("LD_LIBRARY_PATH", "").split(":") if entry]
    users = [Path(site.getusersitepackages())]
    return [*prefixes, *packages, *users, *libraries, *_PACKAGES, *map(Path, _SYSTEM)]


if __name__ == "__main__":
    print(json.dumps(asdict(isolate([], []))))
