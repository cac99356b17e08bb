"""The files of a recording by relative path: of a folder, or of an archive of one."""

from __future__ import annotations

import os
from contextlib import closing
from pathlib import Path, PurePosixPath
from typing import Final

from workers.readers.recording import ReadError
from workers.readers.trees.scratch import Scratch, Stream

MAX_FILES: Final = 1_000_000
MAX_FILE_BYTES: Final = 512 * 1024 * 1024


class FileTree:
    """Files by relative POSIX path; hidden ones are not seen.

    Args:
        name: what its owner calls it, for messages.
        scratch: where members are copied to; removed with the tree.
    """

    def __init__(self, name: str, scratch: Scratch | None = None) -> None:
        self.name = name
        self._sizes: dict[str, int] = {}
        self._scratch = scratch or Scratch(name)

    def _add(self, path: str, size: int) -> bool:
        """Take note of a file. Returns whether it is seen.

        Raises:
            ReadError: ``folder_refused``.
        """
        if len(self._sizes) >= MAX_FILES:
            raise refused(self.name, f"it holds more than {MAX_FILES} files")
        if path in self._sizes:
            raise refused(self.name, f"{shortened(path)!r} comes twice in it")
        if not any(part.startswith((".", "__MACOSX")) for part in PurePosixPath(path).parts):
            self._sizes[path] = size
        return path in self._sizes

    @property
    def paths(self) -> list[str]:
        """Relative paths of all files, sorted."""
        return sorted(self._sizes)

    def size(self, path: str) -> int:
        """Bytes of a file."""
        return self._sizes[path]

    def open(self, path: str) -> Stream:
        """A file as a stream, from its beginning."""
        raise NotImplementedError

    def on_disk(self, path: str) -> Path:
        """A file, or a folder with all that is in it, as a path of this machine."""
        raise NotImplementedError

    def close(self) -> None:
        """Remove what was unpacked or copied."""
        self._scratch.close()


def read_file(tree: FileTree, path: str) -> bytes:
    """A whole file.

    Raises:
        ReadError: ``folder_refused``, larger than :data:`MAX_FILE_BYTES`, and what its archive raises.
    """
    size = tree.size(path)
    if size > MAX_FILE_BYTES:
        raise refused(tree.name, f"{shortened(path)!r} has {size} bytes; at most {MAX_FILE_BYTES} are read")
    with closing(tree.open(path)) as file:
        return file.read(size)


def read_head(tree: FileTree, path: str, count: int) -> bytes:
    """The first bytes of a file."""
    with closing(tree.open(path)) as file:
        return file.read(count)


def refused(name: str, why: str) -> ReadError:
    """The refusal of a folder or an archive for what it holds."""
    return ReadError(
        "folder_refused",
        f"{name} was refused: {why}.",
        "Upload a plain folder of the recording's files, without links, or a tar or zip of one.",
    )


def shortened(text: str) -> str:
    """At most 100 characters of a name, for messages."""
    return text if len(text) <= 100 else text[:97] + "..."


class Folder(FileTree):
    """A folder on disk. Links are refused."""

    def __init__(self, root: Path, name: str, scratch: Scratch | None = None) -> None:
        super().__init__(name, scratch)
        self._root = root
        for folder, subfolders, files in os.walk(root):
            for item in (Path(folder) / name for name in (*subfolders, *files)):
                path = item.relative_to(root).as_posix()
                if item.is_symlink():
                    raise refused(name, f"{shortened(path)!r} is a link")
                if not item.is_dir() and not item.is_file():
                    raise refused(name, f"{shortened(path)!r} is no ordinary file")
                if item.is_file():
                    self._add(path, item.stat().st_size)

    def open(self, path: str) -> Stream:
        """A file as a stream."""
        return self.on_disk(path).open("rb")

    def on_disk(self, path: str) -> Path:
        """A file or a folder where it is."""
        return self._root / path
