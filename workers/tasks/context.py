"""The database, store and name that a worker process keeps for its life. They are made after the fork.

Scratch folders of processes that died before they could remove them are removed here.
"""

from __future__ import annotations

import os
import re
import shutil
import socket
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from urllib.parse import quote
from uuid import UUID

from sqlalchemy.orm import undefer

from service.platform.broker.hints import COURIER as HINTS
from service.platform.broker.hints import Publisher
from service.platform.db.base import Json
from service.platform.db.calibrations import CorrespondenceSet
from service.platform.db.session import Database
from service.platform.jobs.messages import COURIER, Sender
from service.platform.settings import Settings, get_settings
from service.platform.storage.store import open_store

# Correspondence sets in memory: megabytes at most.
_SETS = 4


class Context:
    """One per process."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.database = Database(settings.database)
        self.send = self.database.couriers[COURIER] = Sender(settings.broker)
        self.database.couriers[HINTS] = Publisher(settings.events)
        self.store = open_store(settings)
        self.worker = f"{socket.gethostname()}:{os.getpid()}"
        # Sets never change, and the runs of a camera and their bundles all ask for the same one.
        self.pairs_of = lru_cache(maxsize=_SETS)(self._load_pairs)

    def _load_pairs(self, set_id: UUID) -> Json:
        with self.database.reading() as session:
            return session.get_one(CorrespondenceSet, set_id, options=[undefer(CorrespondenceSet.pairs)]).columns

    @contextmanager
    def scratch(self) -> Iterator[Path]:
        """Yield a folder that is removed after the block. `remove_leftovers` removes those of killed workers."""
        self.settings.scratch.mkdir(parents=True, exist_ok=True)
        folder = Path(tempfile.mkdtemp(prefix=scratch_prefix(), dir=self.settings.scratch))
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def fetch(self, key: str, folder: Path) -> Path:
        """Return a blob as a local file: the store's own file if the store is a folder, else a copy in ``folder``."""
        local = self.store.local_path(key)
        if local:
            return local
        copy = folder / key.rsplit("/", 1)[-1]
        with copy.open("wb") as file:
            for chunk in self.store.stream(key):
                file.write(chunk)
        return copy


@lru_cache(maxsize=1)
def get_context() -> Context:
    """This process's context."""
    return Context(get_settings())


# It separates host and process. No quoted host name holds it: hosts may be called `gpu` and `gpu-7`.
_SEPARATOR = "+"


def scratch_prefix() -> str:
    """Return the prefix of this process's scratch folders. Several hosts may share the data folder."""
    return _SEPARATOR.join((_host(), str(os.getpid()), ""))


def remove_leftovers(scratch: Path) -> None:
    """Remove the folders of this host's dead processes."""
    if not scratch.is_dir():
        return
    mine = re.compile(rf"{re.escape(_host() + _SEPARATOR)}(\d+){re.escape(_SEPARATOR)}.*")
    for folder in scratch.iterdir():
        match = mine.fullmatch(folder.name)
        if match and not _alive(int(match[1])):
            shutil.rmtree(folder, ignore_errors=True)


def _host() -> str:
    return quote(socket.gethostname(), safe="")


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
