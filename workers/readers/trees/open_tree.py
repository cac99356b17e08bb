"""Which kind of tree a path is: a folder, a tar, a zip, or one of these compressed."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from workers.readers.damage import on_error
from workers.readers.detect import is_tar
from workers.readers.trees.file_tree import FileTree, Folder, OnDisk
from workers.readers.trees.scratch import Scratch, damaged_archive, packing_of
from workers.readers.trees.tar_tree import Tar
from workers.readers.trees.zip_tree import Zip

_ZIP_MAGICS: Final = (b"PK\x03\x04", b"PK\x05\x06")
_UNPACKED: Final = ".unpacked"  # a hidden name, which no member has
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
    return Tar(path) if packing is None else _unpacked(path, packing)


def _unpacked(path: Path, packing: str) -> FileTree:
    """A compressed tar, or a single compressed file, decompressed into a scratch folder."""
    scratch = Scratch(path.name)
    inner = next((path.name[: -len(s)] for s in _SUFFIXES if path.name.lower().endswith(s)), path.name)
    with on_error(scratch.close):
        file = scratch.unpack(path, packing, f"{_UNPACKED}/{inner if inner.strip('.') else 'recording'}")
        with file.open("rb") as unpacked:
            head = unpacked.read(512)
        if not head:  # zstd stops without a word where its data are cut short
            raise damaged_archive(path.name, "nothing can be unpacked from it")
        if is_tar(head):
            return Tar(file, path.name, scratch)
        return OnDisk(file.parent, path.name, [file.name], scratch)
