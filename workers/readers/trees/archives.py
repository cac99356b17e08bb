"""The files of a tar or a zip, and of what is compressed by itself.

Archives are read in place: no path in them is opened on this machine, so none can climb out of anywhere. Only what a
library must have as a file of its own (a bag, a packet capture, a video) is copied into a scratch folder.
"""

from __future__ import annotations

import os
import stat
import tarfile
import zipfile
from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any, Final, cast

from workers.readers.damage import on_error
from workers.readers.detect import is_tar, read_head
from workers.readers.recording import ReadError
from workers.readers.trees.file_tree import FileTree, Folder, refused, shortened
from workers.readers.trees.scratch import (
    Scratch,
    Stream,
    damaged_archive,
    packing_of,
    refused_expanding,
    unpacking,
)

# Recordings compress to a third or a tenth. An archive that claims far more, past a harmless size, is made to fill
# disks. workers.readers.output counts what is written.
MAX_RATIO: Final = 200
HARMLESS_BYTES: Final = 256 * 1024**2
_ZIP_MAGICS: Final = (b"PK\x03\x04", b"PK\x05\x06")
_LOCAL_HEADER: Final = 30  # bytes before a member's name and data
_SUFFIXES: Final = (".gz", ".bz2", ".xz", ".zst", ".zstd")
_FILE, _LINK, _OTHER = "", "a link", "no ordinary file"
_ZIP_KINDS: Final = {0: _FILE, stat.S_IFREG: _FILE, stat.S_IFLNK: _LINK}


def open_tree(path: Path) -> FileTree:
    """The files of a folder or an archive.

    Raises:
        ReadError: ``folder_refused`` (links, devices, paths that climb out, names that come twice, members that
            overlap), ``recording_truncated``, ``archive_encrypted``, ``archive_expands``.
    """
    if path.is_dir():
        return Folder(path, path.name)
    packing = packing_of(read_head(path))
    if packing is None:
        return Archive(path, path.name)
    scratch = Scratch(path.name)
    inner = next((path.name[: -len(s)] for s in _SUFFIXES if path.name.lower().endswith(s)), path.name)
    with on_error(scratch.close):
        unpacked = scratch.unpack(path, packing, f".unpacked/{inner.lstrip('.') or 'recording'}")
        head = read_head(unpacked)
        if not head:  # zstd stops without a word where its data are cut short
            raise damaged_archive(path.name, "nothing can be unpacked from it")
        return Archive(unpacked, path.name, scratch) if is_tar(head) else Folder(unpacked.parent, path.name, scratch)


class Archive(FileTree):
    """A tar without compression, or a zip, of a folder or of a single recording."""

    def __init__(self, file: Path, name: str, scratch: Scratch | None = None) -> None:
        super().__init__(name, scratch)
        self._size = file.stat().st_size
        self._members: dict[str, Callable[[], Any]] = {}
        with unpacking(name):
            is_zip = read_head(file).startswith(_ZIP_MAGICS)
            self._archive = zipfile.ZipFile(file) if is_zip else tarfile.TarFile(file)
            with on_error(self._archive.close):
                if isinstance(self._archive, zipfile.ZipFile):
                    self._list_zip(self._archive)
                else:
                    self._list_tar(self._archive)
                files = set(self._sizes)
                for parent in (parent.as_posix() for path in files for parent in PurePosixPath(path).parents):
                    if parent in files:
                        raise refused(name, f"{shortened(parent)!r} is both a file and a folder in it")

    def _list_zip(self, archive: zipfile.ZipFile) -> None:
        infos = [info for info in archive.infolist() if not info.filename.endswith("/")]
        for info in infos:
            if info.flag_bits & 0x1:
                raise ReadError(
                    "archive_encrypted",
                    f"{self.name} was refused: {shortened(info.filename)!r} in it is encrypted.",
                    "Pack it again without a password.",
                )
            kind = _ZIP_KINDS.get(stat.S_IFMT(info.external_attr >> 16), _OTHER)
            # No more than the directory states is ever unpacked.
            self._take(info.filename, info.file_size, kind, partial(archive.open, info))
        infos.sort(key=lambda info: info.header_offset)
        ends = (info.header_offset + _LOCAL_HEADER + info.compress_size for info in infos)
        # A broken directory may also point before the file's beginning.
        if any(end > info.header_offset for end, info in zip([0, *ends], infos, strict=False)):
            raise refused(self.name, "files in it overlap")
        if sum(info.file_size for info in infos) > max(HARMLESS_BYTES, MAX_RATIO * self._size):
            raise refused_expanding(self.name)

    def _list_tar(self, archive: tarfile.TarFile) -> None:
        for info in archive:
            if not info.isdir():
                kind = _FILE if info.isreg() and info.sparse is None else _LINK if info.issym() else _OTHER
                self._take(info.name, info.size, kind, partial(archive.extractfile, info))
        # tarfile stops without a word at a broken header; a whole tar ends in blocks of zeros.
        file: Any = archive.fileobj
        file.seek(archive.offset)
        if file.read(512) != bytes(512):
            raise damaged_archive(self.name, f"neither a file nor its end follows at byte {archive.offset}")

    def _take(self, stated: str, size: int, kind: str, opened: Callable[[], Any]) -> None:
        path = PurePosixPath(stated.replace("\\", "/"))
        name = repr(shortened(stated))
        if path.is_absolute() or ".." in path.parts or ":" in stated[:2]:
            raise refused(self.name, f"the path {name} leads out of the folder")
        if not path.parts or len(stated) > 4096 or any(len(os.fsencode(part)) > 255 for part in path.parts):
            raise refused(self.name, f"the path {name} can be no file's")
        if kind:
            raise refused(self.name, f"{name} is {kind}")
        if size < 0:
            raise damaged_archive(self.name, f"{name} has {size} bytes")
        if self._add(path.as_posix(), size):
            self._members[path.as_posix()] = opened

    def open(self, path: str) -> Stream:
        """A file as a stream, unpacked as it is read."""
        return _Member(self._members[path], f"{self.name}: {shortened(path)!r}")

    def on_disk(self, path: str) -> Path:
        """A copy in the scratch folder."""
        for member in self._sizes:
            below = member == path or path == "." or member.startswith(f"{path}/")
            if below and not (self._scratch.root / member).exists():
                with closing(self.open(member)) as stream:
                    self._scratch.write(stream, member)
        return self._scratch.root / path

    def close(self) -> None:
        """Close the archive and remove what was copied out of it."""
        self._archive.close()
        super().close()


class _Member:
    """A member's stream that says what is wrong with it as a :class:`ReadError`."""

    def __init__(self, opened: Callable[[], Any], where: str) -> None:
        self._where = where
        with unpacking(where):
            self._stream = cast(Stream, opened())

    def read(self, size: int = -1, /) -> bytes:
        """The next bytes, at most ``size``."""
        with unpacking(self._where):
            return self._stream.read(size)

    def close(self) -> None:
        """Close the member."""
        self._stream.close()
