"""The files of a folder, or of an uncompressed tar of one, by relative path.

A tar is read in place, never extracted: no path in it is ever opened on this machine, so it cannot climb out of
anywhere, and it takes no second copy's worth of disk.
"""

from __future__ import annotations

import os
import tarfile
from pathlib import Path, PurePosixPath
from typing import Any, Final, Protocol, cast

from workers.readers.recording import ReadError

MAX_FILES: Final = 2_000_000
MAX_FILE_BYTES: Final = 512 * 1024 * 1024


class FileTree(Protocol):
    """Files by relative POSIX path."""

    name: str

    @property
    def paths(self) -> list[str]: ...

    def read(self, path: str) -> bytes: ...

    def close(self) -> None: ...


def _refused(name: str, why: str) -> ReadError:
    return ReadError(
        "folder_refused",
        f"{name} was refused: {why}.",
        "Upload a plain folder of PCD files and images, without links, or an uncompressed tar of one.",
    )


def _hidden(path: str) -> bool:
    return any(part.startswith((".", "__MACOSX")) for part in PurePosixPath(path).parts)


class Folder:
    """A folder on disk. Links are refused; hidden files are not seen."""

    def __init__(self, root: Path) -> None:
        self.name = root.name
        self._root = root
        self._sizes: dict[str, int] = {}
        for folder, subfolders, files in os.walk(root, followlinks=False):
            base = Path(folder)
            for name in (*subfolders, *files):
                if (base / name).is_symlink():
                    raise _refused(root.name, f"{(base / name).relative_to(root)} is a link")
            for name in files:
                relative = (base / name).relative_to(root).as_posix()
                if not _hidden(relative):
                    self._sizes[relative] = (base / name).stat().st_size
            if len(self._sizes) > MAX_FILES:
                raise _refused(root.name, f"it holds more than {MAX_FILES} files")

    @property
    def paths(self) -> list[str]:
        """Relative paths of all files, sorted."""
        return sorted(self._sizes)

    def read(self, path: str) -> bytes:
        """The whole file.

        Raises:
            ReadError: ``folder_refused``, larger than :data:`MAX_FILE_BYTES`.
        """
        _check_size(self.name, path, self._sizes[path])
        return (self._root / path).read_bytes()

    def close(self) -> None:
        """Nothing to close."""


class Tar:
    """An uncompressed tar of a folder; a single top folder that holds everything is left out of the paths."""

    def __init__(self, file: Path) -> None:
        self.name = file.name
        self._members: dict[str, tuple[int, int]] = {}
        self._end = 0
        self._size = file.stat().st_size
        self._file = file.open("rb")
        try:
            self._list()
        except BaseException:
            self._file.close()
            raise

    def _list(self) -> None:
        try:
            with tarfile.open(fileobj=self._file, mode="r:") as archive:
                for member in archive:
                    self._add(member)
                    cast(Any, archive).members.clear()  # else the archive keeps every header
        except tarfile.TarError as error:
            raise self._truncated(f"it cannot be read to its end ({error})") from error
        # tarfile stops without a word at a broken header; a whole tar ends in blocks of zeros.
        self._file.seek(self._end)
        if self._file.read(512) != bytes(512):
            raise self._truncated(f"behind byte {self._end} neither another file nor the end of the tar follows")
        tops = {path.partition("/")[0] for path in self._members}
        if len(tops) == 1 and all("/" in path for path in self._members):
            self._members = {path.partition("/")[2]: place for path, place in self._members.items()}

    def _truncated(self, why: str) -> ReadError:
        return ReadError(
            "recording_truncated",
            f"{self.name} is cut short or damaged: {why}.",
            "Pack the folder again with `tar cf`, upload it again, and compare its size with the original's.",
        )

    def _add(self, member: tarfile.TarInfo) -> None:
        path = PurePosixPath(member.name)
        if path.is_absolute() or ".." in path.parts:
            raise _refused(self.name, f"the path {member.name!r} leads out of the folder")
        if member.issym() or member.islnk():
            raise _refused(self.name, f"{member.name!r} is a link")
        self._end = member.offset_data + -(-member.size // 512) * 512
        if member.isdir():
            return
        if not member.isreg() or member.sparse is not None:
            raise _refused(self.name, f"{member.name!r} is no ordinary file")
        if member.offset_data + member.size > self._size:
            raise self._truncated(f"it ends at byte {self._size}, inside {member.name!r}")
        if len(self._members) >= MAX_FILES:
            raise _refused(self.name, f"it holds more than {MAX_FILES} files")
        if not _hidden(path.as_posix()):
            self._members[path.as_posix()] = (member.offset_data, member.size)

    @property
    def paths(self) -> list[str]:
        """Relative paths of all files, sorted."""
        return sorted(self._members)

    def read(self, path: str) -> bytes:
        """The whole file.

        Raises:
            ReadError: ``folder_refused``, larger than :data:`MAX_FILE_BYTES`.
        """
        offset, size = self._members[path]
        _check_size(self.name, path, size)
        self._file.seek(offset)
        return self._file.read(size)

    def close(self) -> None:
        """Close the tar."""
        self._file.close()


def _check_size(name: str, path: str, size: int) -> None:
    if size > MAX_FILE_BYTES:
        raise _refused(name, f"{path} has {size} bytes; at most {MAX_FILE_BYTES} are read")
