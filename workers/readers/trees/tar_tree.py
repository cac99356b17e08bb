"""The files of a tar, read in place; a compressed one is decompressed into a scratch folder first."""

from __future__ import annotations

import tarfile
from pathlib import Path
from typing import Any, cast

from workers.readers.damage import on_error
from workers.readers.trees.file_tree import FileTree, FileWindow, check_tree, checked_path, refused, shortened
from workers.readers.trees.scratch import Scratch, Stream, damaged_archive


class Tar(FileTree):
    """An uncompressed tar of a folder.

    Args:
        file: where it is.
        name: what its owner calls it, for messages; None: the file's name.
        scratch: see :class:`FileTree`.

    Raises:
        ReadError: ``folder_refused`` (links, devices, sparse files, paths that climb out, names that come twice),
            ``recording_truncated``.
    """

    def __init__(self, file: Path, name: str | None = None, scratch: Scratch | None = None) -> None:
        super().__init__(name or file.name, scratch)
        self._offsets: dict[str, int] = {}
        self._end = 0
        self._size = file.stat().st_size
        self._file = file.open("rb")
        with on_error(self._file.close):
            self._list()
            check_tree(self.name, self._sizes)

    def _list(self) -> None:
        try:
            with tarfile.open(fileobj=self._file, mode="r:") as archive:
                for member in archive:
                    self._take(member)
                    cast(Any, archive).members.clear()  # else the archive keeps every header
        except (tarfile.TarError, ValueError, OverflowError) as error:
            raise damaged_archive(self.name, f"it cannot be read to its end ({error})") from error
        except RecursionError as error:  # tarfile goes one call deeper with each
            raise damaged_archive(
                self.name, "it has hundreds of extension headers in a row, and no file behind them"
            ) from error
        # tarfile stops without a word at a broken header; a whole tar ends in blocks of zeros.
        self._file.seek(self._end)
        if self._file.read(512) != bytes(512):
            raise damaged_archive(
                self.name, f"behind byte {self._end} neither another file nor the end of the tar follows"
            )

    def _take(self, member: tarfile.TarInfo) -> None:
        name = shortened(member.name)
        if member.issym() or member.islnk():
            raise refused(self.name, f"{name!r} is a link")
        self._end = member.offset_data + -(-member.size // 512) * 512
        if member.isdir():
            checked_path(self.name, member.name)
            return
        if not member.isreg() or member.sparse is not None:
            raise refused(self.name, f"{name!r} is no ordinary file")
        if member.size < 0 or member.offset_data + member.size > self._size:
            raise damaged_archive(self.name, f"it ends at byte {self._size}, inside {name!r}")
        self._offsets[self._add(member.name, member.size)] = member.offset_data

    def open(self, path: str) -> Stream:
        """A file as a stream."""
        return FileWindow(self._file, self._offsets[path], self._sizes[path])

    def close(self) -> None:
        """Close the tar and remove what was copied out of it."""
        self._file.close()
        super().close()
