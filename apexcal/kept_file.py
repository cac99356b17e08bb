"""A file that is replaced whole or not at all, whenever its writer is killed.

Content goes into a new file beside it, onto the disk, and takes the name in one step. A note beside the file
(``.NAME.pulled``) says what the service calls its content (the ETag), and what was asked. It is written before the
file and knows the one that lies there and the one that comes, each by its hash: whichever lies there is known. A file
that was edited or damaged is neither, and is fetched again.
"""

from __future__ import annotations

import json
import os
import shutil
import tempfile
import time
from collections.abc import Mapping
from contextlib import suppress
from hashlib import sha256
from pathlib import Path

# Longer than any pull takes; older files were left by a pull that was killed.
_LEFT_BEHIND_S = 3600.0


class KeptFile:
    """A file and the note of what it is."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._note = path.with_name(f".{path.name}.pulled")

    def etag(self, question: str) -> str | None:
        """What the service called the content that lies there; None where that is unknown, or was asked otherwise."""
        note = self._read_note()
        return note["etag"] if note is not None and note["asked"] == question else None

    def is_whole(self) -> bool:
        """Whether the file is what was pulled last."""
        return self._read_note() is not None

    def replace(self, content: bytes, etag: str, question: str) -> None:
        """Raises OSError, and then the file is what it was."""
        self._clear()
        coming = {"etag": etag, "asked": question, "sha256": sha256(content).hexdigest()}
        notes = [note for note in (self._read_note(), coming) if note is not None]
        self._put(self._note, json.dumps(notes).encode())
        self._put(self.path, content)

    def _read_note(self) -> dict[str, str] | None:
        """What is known of the file that lies there."""
        try:
            digest = sha256(self.path.read_bytes()).hexdigest()
            notes = [note for note in json.loads(self._note.read_bytes()) if note["sha256"] == digest]
            return {name: str(notes[-1][name]) for name in ("etag", "asked", "sha256")} if notes else None
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def _put(self, target: Path, content: bytes) -> None:
        replace_whole(target, content, self.path.name)

    def _clear(self) -> None:
        for left in self.path.parent.glob(f".{_literal(self.path.name)}.*.part"):
            with suppress(OSError):
                if time.time() - left.stat().st_mtime > _LEFT_BEHIND_S:
                    left.unlink()


def replace_whole(target: Path, content: bytes, name: str) -> None:
    """Give the file this content, whole or not at all. Until then it is ``.NAME.*.part`` beside it.

    If it raises OSError, the file is unchanged.
    """
    descriptor, unfinished = tempfile.mkstemp(prefix=f".{name}.", suffix=".part", dir=target.parent)
    part = Path(unfinished)
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        # mkstemp's files are readable only by their owner, but other programs read this one.
        part.chmod(target.stat().st_mode & 0o777 if target.exists() else 0o644)
        part.replace(target)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
    _keep_names(target.parent)


def replace_folder(link: Path, files: Mapping[str, bytes]) -> None:
    """Make the link lead to a folder of these files and no others, in one step.

    The folder before stays until the next time, for who reads it now. If it raises OSError, the link is unchanged.
    """
    before = link.resolve()
    if link.is_symlink() and _files(before) == files:
        return
    folder = Path(tempfile.mkdtemp(prefix=f".{link.name}.", suffix=".unpacked", dir=link.parent))
    try:
        for name, content in files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            replace_whole(folder / name, content, "unpacked")
        folder.chmod(0o755)
        (folder / ".link").symlink_to(folder.name)
        (folder / ".link").replace(link)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    _keep_names(link.parent)
    for left in link.parent.glob(f".{_literal(link.name)}.*.unpacked"):
        if left not in (folder, before):
            shutil.rmtree(left, ignore_errors=True)


def _files(folder: Path) -> dict[str, bytes]:
    return {str(file.relative_to(folder)): file.read_bytes() for file in folder.rglob("*") if file.is_file()}


def _literal(name: str) -> str:
    return "".join(f"[{letter}]" if letter in "*?[" else letter for letter in name)


def _keep_names(folder: Path) -> None:
    """The folder's own entry of the new name onto the disk, where the system has that."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
