"""Hosts on a network of their own: network namespaces behind a router, whose packets can be made to vanish.

Nothing of it is seen from outside, and nothing is left: a namespace ends with the file that this process holds open
and the processes in it. So tests send to addresses that they made themselves.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

# 198.18.0.0/15 is for tests of networks (RFC 2544) and routed nowhere.
_ADDRESS = "198.18.{}.{}"
NETWORK = "198.18.0.0/15"
_CLONE_NEWNET = 0x40000000
_OWN = "/proc/thread-self/ns/net"
_libc = ctypes.CDLL(None, use_errno=True)


@cache
def why_not() -> str:
    """Why there can be no such network here, in words; empty where there can."""
    if shutil.which("ip") is None:
        return "the command ip is missing (Debian: iproute2)"
    if os.geteuid() != 0:
        return "network namespaces take root"
    try:
        with network() as tried:
            tried.host()
    except (OSError, subprocess.CalledProcessError) as error:
        return f"network namespaces are refused: {error}"
    return ""


class Namespace:
    """A network namespace with nothing but its loopback."""

    def __init__(self) -> None:
        with _back_afterwards():
            if _libc.unshare(_CLONE_NEWNET) != 0:
                raise OSError(ctypes.get_errno(), "unshare")
            self._file = os.open(_OWN, os.O_RDONLY | os.O_CLOEXEC)
        self.path = f"/proc/{os.getpid()}/fd/{self._file}"
        self.run("ip", "link", "set", "lo", "up")

    def enter(self) -> None:
        """This thread is there from now on, with the threads, processes and sockets that it makes."""
        if _libc.setns(self._file, _CLONE_NEWNET) != 0:
            raise OSError(ctypes.get_errno(), "setns")

    @contextmanager
    def inside(self) -> Iterator[None]:
        """The same for a block: what it makes stays there."""
        with _back_afterwards():
            self.enter()
            yield

    def run(self, *command: str) -> None:
        """Run a command in it to its end."""
        with self.inside():
            subprocess.run(command, check=True, capture_output=True)

    def close(self) -> None:
        """Let go of it. It ends with its last process."""
        os.close(self._file)


class Host(Namespace):
    """A namespace with one address and a way to all the other hosts."""

    def __init__(self, router: Namespace, number: int) -> None:
        super().__init__()
        self.number = number
        self.address, gateway = _ADDRESS.format(number, 2), _ADDRESS.format(number, 1)
        self._router, self._link = router, f"host{number}"
        self.vanished = False
        router.run("ip", "link", "add", self._link, "type", "veth", "peer", "name", "eth0", "netns", self.path)
        router.run("ip", "address", "add", f"{gateway}/24", "dev", self._link)
        router.run("ip", "link", "set", self._link, "up")
        self.run("ip", "address", "add", f"{self.address}/24", "dev", "eth0")
        self.run("ip", "link", "set", "eth0", "up")
        self.run("ip", "route", "add", "default", "via", gateway)

    def vanish(self) -> None:
        """Lose all that it sends and all that is sent to it. Neither side is told."""
        if not self.vanished:
            self.vanished = True
            self._drop("add")

    def come_back(self) -> None:
        """As before; what was sent meanwhile is lost."""
        if self.vanished:
            self.vanished = False
            self._drop("del")

    def leave(self) -> None:
        """Unplug it for ever; its address is free."""
        self.come_back()
        self._router.run("ip", "link", "delete", self._link)

    def _drop(self, what: str) -> None:
        for packets in (("iif", self._link), ("to", self.address)):
            self._router.run("ip", "rule", what, "priority", "1", *packets, "blackhole")


class Network:
    """A router, and hosts behind it."""

    def __init__(self) -> None:
        self._router = Namespace()
        self._hosts: list[Host] = []
        with self._router.inside():
            Path("/proc/sys/net/ipv4/ip_forward").write_text("1")

    def host(self) -> Host:
        """One more host."""
        return self._add(len({one.number for one in self._hosts}) + 1)

    def replace(self, host: Host) -> Host:
        """Another host under the address of one that is gone for ever. It knows of no connection."""
        host.leave()
        return self._add(host.number)

    def close(self) -> None:
        """Let go of everything."""
        for one in (*self._hosts, self._router):
            one.close()

    def _add(self, number: int) -> Host:
        self._hosts.append(Host(self._router, number))
        return self._hosts[-1]


@contextmanager
def network() -> Iterator[Network]:
    """A network for a block."""
    made = Network()
    try:
        yield made
    finally:
        made.close()


@contextmanager
def _back_afterwards() -> Iterator[None]:
    """This thread is where it was, after the block."""
    own = os.open(_OWN, os.O_RDONLY | os.O_CLOEXEC)
    try:
        yield
    finally:
        back = _libc.setns(own, _CLONE_NEWNET)
        os.close(own)
        if back != 0:
            raise OSError(ctypes.get_errno(), "setns")
