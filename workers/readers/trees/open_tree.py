"""Which kind of tree a path is: a folder, a tar, a zip, or one of these compressed."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from workers.readers.detect import is_tar
from workers.readers.trees.file_tree import FileTree, Folder, OneFile, Stream
from workers.readers.trees.scratch import Scratch, damaged_archive, packing_of
from workers.readers.trees.tar_tree import Tar
from workers.readers.trees.zip_tree import Zip

_ZIP_MAGICS: Final = (b"PK\x03\x04", b"PK\x05\x06")
_SUFFIXES: Final = (".gz", ".bz2", ".xz", ".zst", ".zstd")


def open_tree(path: Path) -> FileTree:
    """The files of a folder or an archive.

    Raises:
        ReadError: ``folder_refused``, ``recording_truncated``, ``archive_encrypted``, ``archive_expands``.
    """
    if path.is_dir():
        return Folder(path)
    with path.open("rb") as file:
        head = file.read(512)
    if head.startswith(_ZIP_MAGICS):
        return Zip(path)
    packing = packing_of(head)
    return Tar(path) if packing is None else _Unpacked(path, packing)


class _Unpacked:
    """A compressed tar, or a single compressed file, decompressed into a scratch folder."""

    def __init__(self, path: Path, packing: str) -> None:
        self.name = path.name
        self._scratch = Scratch(path.name)
        inner = next((path.name[: -len(s)] for s in _SUFFIXES if path.name.lower().endswith(s)), path.name)
        try:
            file = self._scratch.unpack(path, packing, inner if inner.strip(".") else "recording")
            with file.open("rb") as unpacked:
                head = unpacked.read(512)
            if not head:  # zstd stops without a word where its data are cut short
                raise damaged_archive(path.name, "nothing can be unpacked from it")
            self._tree: FileTree = Tar(file, path.name) if is_tar(head) else OneFile(file, path.name)
        except BaseException:
            self._scratch.close()
            raise

    @property
    def paths(self) -> list[str]:
        """Relative paths of all files, sorted."""
        return self._tree.paths

    def size(self, path: str) -> int:
        """Bytes of a file."""
        return self._tree.size(path)

    def open(self, path: str) -> Stream:
        """A file as a stream."""
        return self._tree.open(path)

    def on_disk(self, path: str) -> Path:
        """A file or folder on disk."""
        return self._tree.on_disk(path)

    def close(self) -> None:
        """Remove what was unpacked."""
        self._tree.close()
        self._scratch.close()
