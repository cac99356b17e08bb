"""Which reader a recording wants, told by its content and not by its name."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from workers.readers.folder import FolderRecording
from workers.readers.recording import ReadError, ReadOptions, Recording
from workers.readers.rosbag1 import Rosbag1Recording

# A format is one file with one such class, and one entry here.
_READERS: Final = (Rosbag1Recording, FolderRecording)
FORMATS: Final = "a ROS 1 bag, a folder of PCD files and images, or an uncompressed tar of such a folder"

_OTHERS: Final[tuple[tuple[bytes, str, str], ...]] = (
    (b"#ROSBAG V1", "a ROS bag of version 1.x", "Convert it with `rosbag fix` or `rosbag migrate` to version 2.0."),
    (b"\x89MCAP0\r\n", "an MCAP file", "MCAP recordings are not read yet; convert it to a ROS 1 bag."),
    (
        b"SQLite format 3\0",
        "an SQLite file, perhaps a ROS 2 bag",
        "Convert it with `rosbags-convert` to a ROS 1 bag.",
    ),
    (
        b"PK\x03\x04",
        "a zip archive",
        "Unpack it, and upload the bag, or a folder or `tar cf` of PCD files and images.",
    ),
    (b"\x1f\x8b", "a gzip archive", "Unpack it, and upload what is inside; pack folders with `tar cf`, without -z."),
    (b"BZh", "a bzip2 archive", "Unpack it, and upload what is inside; pack folders with `tar cf`, without -j."),
    (b"\xfd7zXZ", "an xz archive", "Unpack it, and upload what is inside; pack folders with `tar cf`, without -J."),
    (b"\x28\xb5\x2f\xfd", "a zstd archive", "Unpack it, and upload what is inside."),
    (b"\xd4\xc3\xb2\xa1", "a packet capture", "Packet captures are not read yet; record the point cloud topic."),
    (b"\xa1\xb2\xc3\xd4", "a packet capture", "Packet captures are not read yet; record the point cloud topic."),
    (
        b"\x0a\x0d\x0d\x0a",
        "a packet capture (pcapng)",
        "Packet captures are not read yet; record the point cloud topic.",
    ),
)


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
    if not path.is_dir() and not path.is_file():
        raise ReadError("recording_missing", f"{path.name} is neither a file nor a folder.", "Look at the path.")
    head = b""
    if path.is_file():
        with path.open("rb") as file:
            head = file.read(1024)
        if not head:
            raise ReadError("recording_empty", f"{path.name} holds no bytes.", "Copy or upload the file again.")
    for reader in _READERS:
        if reader.recognises(path, head):
            return reader(path, options or ReadOptions())
    raise _unknown(path, head)


def _unknown(path: Path, head: bytes) -> ReadError:
    for magic, what, hint in _OTHERS:
        if head.startswith(magic):
            return ReadError("not_a_recording", f"{path.name} is {what}, whatever its name says.", hint)
    if b"#ROSBAG V2.0\n".startswith(head):
        return ReadError(
            "recording_truncated", f"{path.name} ends after {len(head)} bytes.", "Copy or upload the file again."
        )
    try:
        text = head[:-4].decode() if len(head) == 1024 else head.decode()
        what = "a text file" if text.isprintable() or "\n" in text else "no format that is known here"
    except UnicodeDecodeError:
        what = f"no format that is known here (it starts with {head[:8].hex(' ')})"
    return ReadError("not_a_recording", f"{path.name} is {what}, whatever its name says.", f"Upload {FORMATS}.")
