"""A scratch folder for members of archives that a library can only read as files."""

from __future__ import annotations

import bz2
import gzip
import lzma
import shutil
import struct
import tarfile
import tempfile
import zipfile
import zlib
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Final, Protocol, cast

import zstandard

from workers.readers.output import OutputLimitError, create
from workers.readers.recording import ReadError

_PIECE: Final = 1024 * 1024
_WINDOW_BYTES: Final = 128 * 1024**2

_BROKEN: Final = (
    *(tarfile.TarError, zipfile.BadZipFile, zlib.error, lzma.LZMAError, zstandard.ZstdError, struct.error, EOFError),
    *(
        NotImplementedError,
        OverflowError,
        RecursionError,
        ValueError,
    ),  # RecursionError: tarfile, at extension headers
)
_PACKED: Final = {b"\x1f\x8b": "gzip", b"BZh": "bzip2", b"\xfd7zXZ\0": "xz", b"\x28\xb5\x2f\xfd": "zstd"}


def packing_of(head: bytes) -> str | None:
    """``gzip``, ``bzip2``, ``xz`` or ``zstd`` from a file's first bytes, else None."""
    return next((name for magic, name in _PACKED.items() if head.startswith(magic)), None)


class Stream(Protocol):
    """Bytes of one file, from its beginning."""

    def read(self, size: int = -1, /) -> bytes: ...

    def close(self) -> None: ...


class Scratch:
    """A temporary folder that is made when it is first needed and removed by :meth:`close`.

    Args:
        name: of the archive, for messages.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._folder: tempfile.TemporaryDirectory[str] | None = None

    @property
    def root(self) -> Path:
        """The folder."""
        if self._folder is None:
            self._folder = tempfile.TemporaryDirectory(prefix="apexcal-unpacked-")
        return Path(self._folder.name)

    def write(self, stream: Stream, relative: str) -> Path:
        """Copy a stream to its end into a file.

        Args:
            stream: the unpacked bytes.
            relative: path in the folder, checked by the caller to stay in it.

        Raises:
            ReadError: ``archive_expands`` where they grow past what this recording may write.
        """
        path = self.root / relative
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with create(path) as out:
                shutil.copyfileobj(stream, out, _PIECE)
        except OutputLimitError as error:
            raise refused_expanding(self._name) from error
        return path

    def unpack(self, file: Path, packing: str, relative: str) -> Path:
        """Decompress a whole file into one of the folder.

        Raises:
            ReadError: ``archive_expands``, ``recording_truncated`` where the packed data are cut short or damaged.
        """
        with unpacking(self._name), file.open("rb") as packed, _decompressor(packed, packing) as stream:
            return self.write(stream, relative)

    def close(self) -> None:
        """Remove the folder."""
        if self._folder is not None:
            self._folder.cleanup()
            self._folder = None


def _decompressor(packed: IO[bytes], packing: str) -> IO[bytes]:
    if packing == "gzip":
        return cast(IO[bytes], gzip.GzipFile(fileobj=packed))
    if packing == "bzip2":
        return cast(IO[bytes], bz2.BZ2File(packed))
    if packing == "xz":
        return cast(IO[bytes], lzma.LZMAFile(packed))
    decompressor = zstandard.ZstdDecompressor(max_window_size=_WINDOW_BYTES)
    return cast(IO[bytes], decompressor.stream_reader(packed, read_across_frames=True))


@contextmanager
def unpacking(name: str) -> Generator[None]:
    """Turn what libraries raise on damaged archives into ``recording_truncated``."""
    try:
        yield
    except (*_BROKEN, OSError) as error:
        if isinstance(error, OSError) and error.errno is not None:  # the disk's; bz2 and gzip state none
            raise
        raise damaged_archive(name, str(error) or type(error).__name__) from error


def refused_expanding(name: str) -> ReadError:
    """The refusal of an archive that unpacks to too much."""
    return ReadError(
        "archive_expands",
        f"{name} was refused: it unpacks to far more than a recording of its size holds.",
        "Upload the recording unpacked, as a folder or as a tar without compression.",
    )


def damaged_archive(name: str, why: str) -> ReadError:
    """The refusal of an archive whose bytes contradict each other or end too early."""
    return ReadError(
        "recording_truncated",
        f"{name} is cut short or damaged: {why.rstrip('.')}.",
        "Pack the recording again, upload it again, and compare its size with the original's.",
    )
