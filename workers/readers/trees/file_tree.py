"""The files of a recording by relative path: of a folder, or of an archive of one.

Archives are read in place: no path in them is opened on this machine, so none can climb out of anywhere. Only what a
library must have as a file of its own (a bag, a packet capture, a video) is copied into a scratch folder.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from contextlib import closing
from pathlib import Path, PurePosixPath
from typing import IO, Final

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

    is_packed = False

    def __init__(self, name: str, scratch: Scratch | None = None) -> None:
        self.name = name
        self._sizes: dict[str, int] = {}
        self._scratch = scratch or Scratch(name)

    def _add(self, stated: str, size: int) -> str:
        """Take note of a member of an archive. Returns its path.

        Raises:
            ReadError: ``folder_refused``.
        """
        path = checked_path(self.name, stated)
        if len(self._sizes) >= MAX_FILES:
            raise refused(self.name, f"it holds more than {MAX_FILES} files")
        if path in self._sizes:
            raise refused(self.name, f"{shortened(stated)!r} comes twice in it")
        if not is_hidden(path):
            self._sizes[path] = size
        return path

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
        """A file, or a folder with all that is in it, as a path of this machine: a copy in the scratch folder."""
        for member in self._sizes:
            below = member == path or path == "." or member.startswith(f"{path}/")
            if below and not (self._scratch.root / member).exists():
                with closing(self.open(member)) as stream:
                    self._scratch.write(stream, member, expanding=self.is_packed)
        return self._scratch.root / path

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


def is_hidden(path: str) -> bool:
    """Whether a file is one that systems leave behind and nobody means."""
    return any(part.startswith((".", "__MACOSX")) for part in PurePosixPath(path).parts)


def checked_path(archive: str, stated: str) -> str:
    """A member's path, as POSIX and relative.

    Raises:
        ReadError: ``folder_refused`` for a path that leads out of the folder or that no system can have.
    """
    path = PurePosixPath(stated.replace("\\", "/"))
    if path.is_absolute() or ".." in path.parts or ":" in stated[:2]:
        raise refused(archive, f"the path {shortened(stated)!r} leads out of the folder")
    if "\0" in stated or len(stated) > 4096 or any(len(os.fsencode(part)) > 255 for part in path.parts):
        raise refused(archive, f"the path {shortened(stated)!r} can be no file's")
    return path.as_posix()


def shortened(text: str) -> str:
    """At most 100 characters of a name, for messages."""
    return text if len(text) <= 100 else text[:97] + "..."


def check_tree(archive: str, paths: Iterable[str]) -> None:
    """Look for members that are file and folder at once.

    Raises:
        ReadError: ``folder_refused``.
    """
    files = set(paths)
    for path in files:
        for parent in PurePosixPath(path).parents:
            if parent.as_posix() in files:
                raise refused(archive, f"{shortened(parent.as_posix())!r} is both a file and a folder in it")


class OnDisk(FileTree):
    """Files in a folder on disk: a single one, which came out of a compressed one such as ``walk.bag.gz``."""

    def __init__(self, root: Path, name: str, files: Iterable[str] = (), scratch: Scratch | None = None) -> None:
        super().__init__(name, scratch)
        self._root = root
        self._sizes = {file: (root / file).stat().st_size for file in files}

    def open(self, path: str) -> Stream:
        """A file as a stream."""
        return (self._root / path).open("rb")

    def on_disk(self, path: str) -> Path:
        """A file or a folder where it is."""
        return self._root / path


class Folder(OnDisk):
    """A folder on disk. Links are refused."""

    def __init__(self, root: Path) -> None:
        super().__init__(root, root.name)
        for folder, subfolders, files in os.walk(root, followlinks=False):
            base = Path(folder)
            for name in (*subfolders, *files):
                if (base / name).is_symlink():
                    raise refused(root.name, f"{shortened((base / name).relative_to(root).as_posix())!r} is a link")
            for name in files:
                relative = (base / name).relative_to(root).as_posix()
                if not (base / name).is_file():
                    raise refused(root.name, f"{shortened(relative)!r} is no ordinary file")
                if not is_hidden(relative):
                    self._sizes[relative] = (base / name).stat().st_size
            if len(self._sizes) > MAX_FILES:
                raise refused(root.name, f"it holds more than {MAX_FILES} files")


class FileWindow:
    """A part of an open file as a stream of its own."""

    def __init__(self, file: IO[bytes], offset: int, size: int) -> None:
        self._file, self._place, self._end = file, offset, offset + size

    def read(self, size: int = -1, /) -> bytes:
        """The next bytes, at most ``size``."""
        left = self._end - self._place
        self._file.seek(self._place)
        data = self._file.read(left if size < 0 else min(size, left))
        self._place += len(data)
        return data

    def close(self) -> None:
        """The file stays open."""
