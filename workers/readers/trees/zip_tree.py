"""The files of a zip archive, read in place."""

from __future__ import annotations

import stat
import struct
import zipfile
import zlib
from lzma import LZMAError
from pathlib import Path
from typing import IO, Final

from workers.readers.damage import on_error
from workers.readers.recording import ReadError
from workers.readers.trees.file_tree import FileTree, check_tree, checked_path, refused, shortened
from workers.readers.trees.scratch import Stream, damaged_archive, expands_too_far, refused_expanding

_PACKINGS: Final = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)
_LOCAL_HEADER: Final = 30  # bytes before a member's name and data
# zipfile reads the whole directory into memory before anybody can look at it.
_MAX_DIRECTORY_BYTES: Final = 200 * 1024 * 1024
_BROKEN: Final = (zipfile.BadZipFile, EOFError, zlib.error, LZMAError, struct.error, ValueError, NotImplementedError)


class Zip(FileTree):
    """A zip of a folder, or of a single recording.

    Raises:
        ReadError: ``folder_refused`` (links, encryption, paths that climb out, names that come twice, members that
            overlap), ``archive_expands``, ``recording_truncated``.
    """

    is_packed = True

    def __init__(self, file: Path) -> None:
        super().__init__(file.name)
        self._size = file.stat().st_size
        self._members: dict[str, zipfile.ZipInfo] = {}
        self._check_directory(file)
        try:
            self._zip = zipfile.ZipFile(file)
        except _BROKEN as error:
            raise damaged_archive(self.name, str(error)) from error
        with on_error(self._zip.close):
            for info in self._zip.infolist():
                self._take(info)
            self._check_sizes()
            check_tree(self.name, self._sizes)

    def _check_directory(self, file: Path) -> None:
        """Refuse an absurd directory by its end record, before it is read."""
        with file.open("rb") as raw:
            raw.seek(max(0, self._size - 65_557 - 20))
            tail = raw.read()
            offset = tail.rfind(b"PK\x05\x06")
            if offset < 0 or offset + 22 > len(tail):
                raise damaged_archive(self.name, "its directory, which stands at the end of a zip, is missing")
            (directory,) = struct.unpack_from("<I", tail, offset + 12)
            # zipfile believes a zip64 record wherever its locator is there, whatever the short record says.
            if offset >= 20 and tail.startswith(b"PK\x06\x07", offset - 20):
                (stated,) = struct.unpack_from("<Q", tail, offset - 12)
                before = self._size - len(tail) + offset - 20 - 56
                directory = max(
                    directory, _long_directory(raw, before), _long_directory(raw, min(stated, self._size))
                )
        if directory > _MAX_DIRECTORY_BYTES:
            raise refused(self.name, f"its directory alone takes {directory} bytes")

    def _take(self, info: zipfile.ZipInfo) -> None:
        path = checked_path(self.name, info.filename)
        mode = info.external_attr >> 16
        if not info.filename:
            raise refused(self.name, "a file in it has no name")
        if info.is_dir():
            return
        if stat.S_IFMT(mode) not in (0, stat.S_IFREG):
            kind = "a link" if stat.S_ISLNK(mode) else "no ordinary file"
            raise refused(self.name, f"{shortened(info.filename)!r} is {kind}")
        if info.flag_bits & 0x1:
            raise ReadError(
                "archive_encrypted",
                f"{self.name} was refused: {shortened(path)!r} in it is encrypted.",
                "Pack it again without a password.",
            )
        if info.compress_type not in _PACKINGS:
            raise refused(
                self.name,
                f"{shortened(path)!r} is packed by a method (number {info.compress_type}), which is not read",
            )
        # No more than the directory states is ever unpacked.
        self._add(path, info.file_size)
        if path in self._sizes:
            self._members[path] = info

    def _check_sizes(self) -> None:
        members = sorted(self._members.values(), key=lambda info: info.header_offset)
        if members and members[0].header_offset < 0:
            raise damaged_archive(self.name, "its directory points before its beginning")
        ends = (info.header_offset + _LOCAL_HEADER + info.compress_size for info in members)
        overlap = any(end > after.header_offset for end, after in zip(ends, members[1:], strict=False))
        if overlap or sum(info.compress_size for info in members) > self._size:
            raise refused(self.name, "files in it overlap")
        if expands_too_far(self._size, sum(info.file_size for info in members)):
            raise refused_expanding(self.name)

    def open(self, path: str) -> Stream:
        """A file as a stream, unpacked as it is read."""
        try:
            return _Unpacking(self._zip.open(self._members[path]), f"{self.name}: {shortened(path)!r}")
        except _BROKEN as error:
            raise damaged_archive(f"{self.name}: {shortened(path)!r}", str(error)) from error

    def close(self) -> None:
        """Close the zip and remove what was unpacked."""
        self._zip.close()
        super().close()


def _long_directory(raw: IO[bytes], offset: int) -> int:
    """Bytes of the directory as a zip64 record at that place says; 0 where there is none."""
    raw.seek(max(0, offset))
    record = raw.read(56)
    return int(struct.unpack_from("<Q", record, 40)[0]) if record[:4] == b"PK\x06\x06" and len(record) == 56 else 0


class _Unpacking:
    """A member's stream that says what is wrong with it as a :class:`ReadError`."""

    def __init__(self, member: IO[bytes], where: str) -> None:
        self._member, self._where = member, where

    def read(self, size: int = -1, /) -> bytes:
        """The next bytes, at most ``size``."""
        try:
            return self._member.read(size)
        except (*_BROKEN, OSError) as error:  # bz2 raises OSError without an errno; anything else is the disk's
            if isinstance(error, OSError) and error.errno is not None:
                raise
            raise damaged_archive(self._where, str(error) or type(error).__name__) from error

    def close(self) -> None:
        """Close the member."""
        self._member.close()
