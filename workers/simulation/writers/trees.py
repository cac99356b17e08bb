"""A tree of files that grows: a folder, or an archive of one."""

from __future__ import annotations

import io
import tarfile
import zipfile
from pathlib import Path
from typing import Protocol

from workers.simulation.writers.recording import refuse_existing

_DEFLATED = (".pcd", ".csv", ".txt", ".bin")  # images are compressed already


class Tree(Protocol):
    """Where files of a recording go.

    Attributes:
        path: the folder or the archive.
    """

    path: Path

    def put(self, name: str, data: bytes) -> None:
        """Add a file; ``name`` is its path in the tree, with slashes."""
        ...

    def close(self) -> None: ...


class FolderTree:
    """Files on disk. Raises FileExistsError where the folder is there already."""

    def __init__(self, path: Path) -> None:
        refuse_existing(path)
        self.path = path

    def put(self, name: str, data: bytes) -> None:
        file = self.path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(data)

    def close(self) -> None:
        """Nothing is open."""


class TarTree:
    """An uncompressed tar. Raises FileExistsError where it is there already."""

    def __init__(self, path: Path) -> None:
        refuse_existing(path)
        self.path = path
        self._tar = tarfile.open(path, "w", format=tarfile.USTAR_FORMAT)  # noqa: SIM115 (close does it)

    def put(self, name: str, data: bytes) -> None:
        entry = tarfile.TarInfo(name)
        entry.size = len(data)
        entry.mode = 0o644
        self._tar.addfile(entry, io.BytesIO(data))

    def close(self) -> None:
        self._tar.close()


class ZipTree:
    """A zip; images are stored as they are. Raises FileExistsError where it is there already."""

    def __init__(self, path: Path) -> None:
        refuse_existing(path)
        self.path = path
        self._zip = zipfile.ZipFile(path, "w")

    def put(self, name: str, data: bytes) -> None:
        entry = zipfile.ZipInfo(name)  # of 1980: the same settings give the same bytes
        entry.external_attr = 0o644 << 16
        deflated = name.endswith(_DEFLATED)
        entry.compress_type = zipfile.ZIP_DEFLATED if deflated else zipfile.ZIP_STORED
        self._zip.writestr(entry, data, compresslevel=1)

    def close(self) -> None:
        self._zip.close()
