"""Chooses a recording's reader by its content, not by its name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Final, cast

from apexcal.documents.readings import ReadOptions
from workers.readers.recording import ReadError, Recording

HEAD_BYTES: Final = 1024
# What files begin with.
ROSBAG1: Final = b"#ROSBAG V2.0\n"
SQLITE: Final = b"SQLite format 3\0"
MCAP: Final = b"\x89MCAP0\r\n"
_CAPTURES: Final = (b"\xd4\xc3\xb2\xa1", b"\xa1\xb2\xc3\xd4", b"\x4d\x3c\xb2\xa1", b"\xa1\xb2\x3c\x4d", b"\n\r\r\n")
FORMATS: Final = (
    "a ROS 1 bag, a ROS 2 bag, an MCAP file, a capture of a LiDAR's packets (pcap, pcapng), or a folder, zip or "
    "tar of these, of videos, and of clouds (PCD, PLY, KITTI, .npy, .csv) and images"
)


@dataclass(frozen=True, slots=True)
class FileFormat:
    """A format of one file, told by its first bytes; its reader is imported only when it is met.

    Attributes:
        module, reader: where the class is; it is constructed with the path and the options.
        matches: whether a file of this format may begin with these :data:`HEAD_BYTES`.
    """

    module: str
    reader: str
    matches: Callable[[bytes], bool]

    def open(self, path: Path, options: ReadOptions) -> Recording:
        """Import the reader and open a file with it."""
        return cast(Recording, getattr(import_module(self.module), self.reader)(path, options))


def read_head(path: Path) -> bytes:
    """The first :data:`HEAD_BYTES` of a file."""
    with path.open("rb") as file:
        return file.read(HEAD_BYTES)


def _starts(*magics: bytes) -> Callable[[bytes], bool]:
    return lambda head: head.startswith(magics)


def is_tar(head: bytes) -> bool:
    """A header with tar's magic, or of an old tar, whose checksum is all there is to tell it by."""
    if head[257:262] == b"ustar":
        return True
    if len(head) < 512 or not head[0]:
        return False
    stated = head[148:156].strip(b" \0")
    expected = sum(head[:148]) + 8 * ord(" ") + sum(head[156:512])
    return bool(stated) and all(c in b"01234567" for c in stated) and int(stated, 8) == expected


def _is_archive(head: bytes) -> bool:
    """A zip, a tar, or something compressed: gzip, bzip2, xz, zstd."""
    packed = (b"PK\x03\x04", b"PK\x05\x06", b"\x1f\x8b", b"BZh", b"\xfd7zXZ\0", b"\x28\xb5\x2f\xfd")
    return head.startswith(packed) or is_tar(head)


def _is_video(head: bytes) -> bool:
    """An ISO base media file (MP4, MOV), AVI, or Matroska."""
    return head[4:8] == b"ftyp" or (head[:4] == b"RIFF" and head[8:12] == b"AVI ") or head[:4] == b"\x1aE\xdf\xa3"


# A format of one file is one module with one class, and one line here.
FILES: Final[tuple[FileFormat, ...]] = (
    FileFormat("workers.readers.ros.rosbag1", "Rosbag1Recording", _starts(ROSBAG1)),
    FileFormat("workers.readers.ros.rosbag2", "Rosbag2Recording", _starts(SQLITE, MCAP)),
    FileFormat("workers.readers.captures.pcap", "PcapRecording", _starts(*_CAPTURES)),
    FileFormat("workers.readers.images.video", "VideoRecording", _is_video),
)
# Folders and archives hold files of these formats, or clouds and images.
TREE: Final = FileFormat("workers.readers.trees.folder", "FolderRecording", _is_archive)

_WHOLE: Final = "Upload the folder with all clouds and images, or a zip or tar of it."
_OTHERS: Final[tuple[tuple[bytes, str, str], ...]] = (
    (b"#ROSBAG V1", "a ROS bag of version 1.x", "Convert it with `rosbag fix` or `rosbag migrate` to version 2.0."),
    (b"7z\xbc\xaf\x27\x1c", "a 7z archive", "Pack the recording as zip or tar."),
    (b"Rar!\x1a\x07", "a RAR archive", "Pack the recording as zip or tar."),
    *((magic, "a single point cloud", _WHOLE) for magic in (b"ply\n", b"ply\r\n", b"# .PCD")),
    *((magic, "a single image", _WHOLE) for magic in (b"\xff\xd8\xff", b"\x89PNG\r\n")),
)


def format_of(head: bytes) -> FileFormat | None:
    """The format of a file that begins with these bytes; None for archives and for what is not known."""
    return next((format_ for format_ in FILES if format_.matches(head)), None)


def open_recording(path: str | Path, options: ReadOptions | None = None) -> Recording:
    """Open a recording of any known format.

    Args:
        path: a file or a folder.
        options: what the owner knows and the file does not say.

    Raises:
        ReadError: ``not_a_recording``, ``recording_empty``, ``recording_missing``, and what the
            format's reader raises.
    """
    path = Path(path)
    options = options or ReadOptions()
    if path.is_dir():
        return TREE.open(path, options)
    if not path.is_file():
        raise ReadError("recording_missing", f"{path.name} is neither a file nor a folder.", "Look at the path.")
    head = read_head(path)
    if not head:
        raise ReadError("recording_empty", f"{path.name} holds no bytes.", "Copy or upload the file again.")
    format_ = format_of(head) or (TREE if TREE.matches(head) else None)
    if format_ is None:
        raise _unknown(path, head)
    return format_.open(path, options)


def _unknown(path: Path, head: bytes) -> ReadError:
    for magic, what, hint in _OTHERS:
        if head.startswith(magic):
            return ReadError("not_a_recording", f"{path.name} is {what}, whatever its name says.", hint)
    if ROSBAG1.startswith(head):
        return ReadError(
            "recording_truncated", f"{path.name} ends after {len(head)} bytes.", "Copy or upload the file again."
        )
    try:
        text = head[:-4].decode() if len(head) == HEAD_BYTES else head.decode()
        what = "a text file" if text.isprintable() or "\n" in text else "no format that is known here"
    except UnicodeDecodeError:
        what = f"no format that is known here (it starts with {head[:8].hex(' ')})"
    return ReadError("not_a_recording", f"{path.name} is {what}, whatever its name says.", f"Upload {FORMATS}.")
