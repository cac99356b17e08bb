"""What can be uploaded: a file as it is, or a folder as a tar that is never written anywhere."""

from __future__ import annotations

import os
import tarfile
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from apexcal.errors import ClientError, InputError

_BLOCK = tarfile.BLOCKSIZE


class Source(Protocol):
    """Bytes of a known number that can be read anywhere, any number of times, with the same outcome."""

    name: str
    size: int

    def read(self, offset: int, length: int) -> bytes:
        """The bytes from ``offset``, fewer than ``length`` only at the end."""
        ...


def open_source(path: Path) -> Source:
    """The source for a file or folder. Raises :class:`InputError` where there is nothing to upload."""
    if path.is_dir():
        return FolderSource(path)
    log = path.with_name(f"{path.name}-wal")
    if path.suffix == ".db3" and path.is_file() and log.is_file():  # messages that are nowhere else
        return FolderSource(path, [(file.name, file) for file in (path, log)])
    if path.is_file():
        return FileSource(path)
    raise InputError(f"there is no file or folder {path}", "Give the path of a recording, or of a folder of one.")


class FileSource:
    """A file, byte for byte."""

    def __init__(self, path: Path) -> None:
        self.name = path.name
        self.size = path.stat().st_size
        self._path = path
        if self.size == 0:
            raise InputError(f"{path} is empty", "Was it copied to its end?")

    def read(self, offset: int, length: int) -> bytes:
        """The bytes from ``offset``. Raises :class:`ClientError` where the file has become shorter."""
        return _read(self._path, offset, min(length, self.size - offset))


@dataclass(frozen=True)
class _Piece:
    """Bytes ``start`` to ``end`` of a tar: given ones, or those of a file."""

    start: int
    end: int
    data: bytes | None
    path: Path | None


class FolderSource:
    """A folder as an uncompressed tar (POSIX pax), its bytes a function of names and contents alone.

    Files are sorted by name, owners and times are left out, so the same folder uploads as the same parts and an
    interrupted upload goes on where it stopped. Names that begin with a dot are left out; links are followed for
    files, not for folders. ``chosen``: names and paths of the files, instead of all that the folder holds.
    """

    def __init__(self, folder: Path, chosen: Sequence[tuple[str, Path]] | None = None) -> None:
        self.name = folder.resolve().name + ".tar"
        self._pieces: list[_Piece] = []
        self.size = 0
        files = sorted(_files(folder) if chosen is None else chosen)
        if not files:
            raise InputError(f"{folder} holds no files", "Give the folder that holds the clouds and the images.")
        for name, path in files:
            self._add_file(name, path)
        self._add(b"\0" * (2 * _BLOCK))

    def read(self, offset: int, length: int) -> bytes:
        """The bytes of the tar from ``offset``. Raises :class:`ClientError` where a file has become shorter."""
        end = min(offset + length, self.size)
        parts: list[bytes] = []
        for piece in self._pieces[bisect_right(self._pieces, offset, key=lambda piece: piece.end) :]:
            if piece.start >= end:
                break
            first, last = max(offset, piece.start) - piece.start, min(end, piece.end) - piece.start
            if piece.data is not None:
                parts.append(piece.data[first:last])
            elif piece.path is not None:
                parts.append(_read(piece.path, first, last - first))
        return b"".join(parts)

    def _add_file(self, name: str, path: Path) -> None:
        member = tarfile.TarInfo(name)
        member.size = path.stat().st_size
        member.mode = 0o644
        self._add(member.tobuf(tarfile.PAX_FORMAT))
        if member.size:
            self._pieces.append(_Piece(self.size, self.size + member.size, None, path))
            self.size += member.size
            self._add(b"\0" * (-member.size % _BLOCK))

    def _add(self, data: bytes) -> None:
        if data:
            self._pieces.append(_Piece(self.size, self.size + len(data), data, None))
            self.size += len(data)


def _files(folder: Path) -> list[tuple[str, Path]]:
    files: list[tuple[str, Path]] = []
    for root, folders, names in os.walk(folder):
        folders[:] = [name for name in folders if not name.startswith(".")]
        paths = [Path(root) / name for name in names if not name.startswith(".")]
        files += [(path.relative_to(folder).as_posix(), path) for path in paths if path.is_file()]
    return files


def _read(path: Path, offset: int, length: int) -> bytes:
    with path.open("rb") as file:
        file.seek(offset)
        data = file.read(length)
    if len(data) != length:
        raise ClientError(f"{path} became shorter while it was read", "Is it still being written? Upload it then.")
    return data
