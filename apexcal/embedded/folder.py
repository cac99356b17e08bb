"""The data folder of an embedded service: its lock and its paths."""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
import shlex
import shutil
import stat
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

from apexcal.documents.served_folder import read_status

DEFAULT = Path("var/apexcal")
# sockaddr_un.sun_path holds 108 bytes with its final zero on Linux, 104 on macOS.
LONGEST_SOCKET = 103


class FolderInUseError(Exception):
    """Another embedded service runs on this folder."""

    def __init__(self, root: Path, holder: dict[str, Any]) -> None:
        where = f" at {holder['url']}" if holder.get("url") else ""
        super().__init__(f"another `apexcal serve` (process {holder.get('pid', 'unknown')}{where}) uses {root}")


class OpenFolderError(Exception):
    """Other users may read the folder, and this command must not close it."""

    def __init__(self, root: Path, reason: str) -> None:
        super().__init__(f"other users may read {root}, and it {reason}")
        close = f"close it (chmod 700 {shlex.quote(str(root))})"
        self.hint = f"Recordings show people: {close}, or name another folder with --data."


@dataclass
class DataFolder:
    """Everything that an embedded service keeps. Only its owner may read it, because recordings show people."""

    root: Path
    _lock: IO[str] | None = field(default=None, repr=False)
    _short: Path | None = field(default=None, repr=False)

    @property
    def logs(self) -> Path:
        """One log file per child."""
        return self.root / "logs"

    @property
    def status(self) -> Path:
        """What the supervisor reports about its children. The API's ``/readyz`` reads it."""
        return self.root / "supervisor.json"

    @property
    def owner_token(self) -> Path:
        """The owner's API token, for the command line on this machine."""
        return self.root / "owner.token"

    @property
    def socket(self) -> Path:
        """The broker's socket. It is in a temporary folder if the data folder's path is too long for a socket."""
        return (self._short or self.root) / "broker.sock"

    def hold(self) -> bool:
        """Make the folder and lock it for this process. Returns whether it had to be closed to others.

        The lock ends with the process, however that ends. Raises :class:`FolderInUseError`, :class:`OpenFolderError`.
        """
        self.root.mkdir(parents=True, exist_ok=True, mode=0o700)
        was_open = _close(self.root)
        self.logs.mkdir(exist_ok=True)
        lock = (self.root / "serve.lock").open("a+")
        if not _taken(lock):
            lock.close()
            raise FolderInUseError(self.root, read_status(self.root))
        self._lock = lock
        # A killed service left this; another program may have its address by now.
        self.status.unlink(missing_ok=True)
        if len(os.fsencode(self.root / "broker.sock")) > LONGEST_SOCKET:
            self._short = _short_folder(self.root)
        return was_open

    def release(self) -> None:
        """Give the folder back. The lock file stays: removing it would let two holders in."""
        self.status.unlink(missing_ok=True)
        if self._short:
            shutil.rmtree(self._short, ignore_errors=True)
        if self._lock:
            self._lock.close()
            self._lock = None


def _close(root: Path) -> bool:
    """Close the folder to everybody but its owner. Returns whether it was open. Raises :class:`OpenFolderError`."""
    state = root.stat()
    if not state.st_mode & (stat.S_IRWXG | stat.S_IRWXO):
        return False
    if state.st_uid != os.geteuid():
        raise OpenFolderError(root, "belongs to another user")
    names = {path.name for path in root.iterdir()}
    # Somebody's home, or a folder of web pages, may be open for a reason.
    if names and not names & {"serve.lock", "apexcal.db"}:
        raise OpenFolderError(root, "holds other things than a service's data")
    root.chmod(0o700)
    return True


def _taken(lock: IO[str]) -> bool:
    """Whether the lock is ours now. Tries again, because a process in :func:`is_served` holds it for a moment."""
    for pause in (0.01, 0.02, 0.05, 0.1, 0.0):
        with contextlib.suppress(BlockingIOError):
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return True
        time.sleep(pause)
    return False


def _short_folder(root: Path) -> Path:
    """A private temporary folder with a short path. Its name is fixed, so killed services leave one, not many."""
    digest = hashlib.sha256(os.fsencode(root)).hexdigest()[:16]
    folder = Path(tempfile.gettempdir()) / f"apexcal-{os.getuid()}-{digest}"
    with contextlib.suppress(FileExistsError):
        folder.mkdir(mode=0o700)
    status = folder.lstat()
    if stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid() and status.st_mode & 0o077 == 0:
        return folder
    # Another user made a folder of that name.
    return Path(tempfile.mkdtemp(prefix="apexcal-"))
