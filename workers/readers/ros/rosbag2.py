"""ROS 2 bags and other MCAP files: SQLite (.db3) or MCAP, bare or in a folder with metadata.yaml."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from importlib import import_module
from pathlib import Path, PurePath
from typing import Any, Final, cast

from apexcal.documents.readings import ReadOptions
from workers.readers.detect import MCAP, SQLITE, read_head
from workers.readers.recording import ReadError
from workers.readers.ros.containers import Container, SplitContainer
from workers.readers.ros.topics import TopicRecording
from workers.readers.trees.scratch import Scratch, packing_of
from workers.readers.trees.split_files import split_name

METADATA: Final = "metadata.yaml"
_METADATA_BYTES: Final = 2_000_000
_MAX_FILES: Final = 10_000
_ENDS: Final = (".db3", ".mcap")


class Rosbag2Recording(TopicRecording):
    """A ROS 2 bag or an MCAP file.

    Raises:
        ReadError: ``recording_truncated``, ``recording_damaged``, ``bag_incomplete``, ``not_a_recording``,
            ``archive_expands``.
    """

    def __init__(self, path: Path, options: ReadOptions) -> None:
        super().__init__(open_bag(path), options)


def _unpacked_file(path: Path, scratch: Scratch) -> Path:
    """One file of a bag, decompressed where it is packed as a whole."""
    if packing_of(read_head(path)) == "zstd":
        return scratch.unpack(path, "zstd", path.name.removesuffix(".zstd") + ".unpacked")
    return path


def _open_file(path: Path, scratch: Scratch) -> Container:
    path = _unpacked_file(path, scratch)
    head = read_head(path)
    # Each needs a library of its own, so the module is loaded when its format is met.
    if head.startswith(MCAP):
        return cast(Container, import_module("workers.readers.ros.mcap_bag").McapBag(path))
    if head.startswith(SQLITE):
        return cast(Container, import_module("workers.readers.ros.sqlite_bag").SqliteBag(path))
    raise ReadError(
        "not_a_recording",
        f"{path.name} is no file of a ROS 2 bag (it starts with {head[:8].hex(' ') or 'nothing'}).",
        "Copy or upload the bag again; its files are SQLite (.db3) or MCAP.",
    )


def open_bag(path: Path) -> Container:
    """Open a bag's file, or all files of its folder. Raises as :class:`Rosbag2Recording` does."""
    warnings: list[str] = []
    return _open_files(path, [path] if path.is_file() else _bag_files(path, warnings), warnings)


def _open_files(path: Path, parts: Sequence[Path], warnings: Sequence[str] = ()) -> Container:
    """Open the files of a bag, one after the other."""
    files: list[Container] = []
    with ExitStack() as stack:
        scratch = Scratch(path.name)
        stack.callback(scratch.close)
        for file in parts:
            files.append(_open_file(file, scratch))
            stack.callback(files[-1].close)
        return SplitContainer(files, warnings, stack.pop_all())


def _bag_files(path: Path, warnings: list[str]) -> list[Path]:
    """A bag's files in order, as its metadata say it, else as they are named.

    Raises:
        ReadError: ``bag_incomplete``.
    """
    # A list of lists could stand for itself a million times over.
    names = [name for name in read_metadata(path / METADATA)["relative_file_paths"] if isinstance(name, str)]
    there = [file for file in sorted(path.iterdir()) if file.is_file() and not file.is_symlink()]
    storage_files = [file for file in there if PurePath(file.name.removesuffix(".zstd")).suffix in _ENDS]
    files: list[Path] = []
    missing: list[str] = []
    for name in names[:_MAX_FILES]:
        here = [path / PurePath(name).name, path / f"{PurePath(name).name}.zstd"]
        file = next((file for file in here if file in storage_files), None)
        if file is None:
            missing.append(PurePath(name).name)
        else:
            files.append(file)
    if missing and files:
        warnings.append(f"{len(missing)} of the bag's {len(names)} files are missing: {missing[0]}.")
    files = files or storage_files
    # A recorder that was interrupted wrote its metadata before its last files.
    stems = {split_name(file.name)[0] for file in files}
    more = [file for file in storage_files if split_name(file.name)[0] in stems and not _has_part(files, file)]
    if more:
        warnings.append(f"{len(more)} of the bag's files are not in {METADATA} and were read: {more[0].name}.")
        files = sorted([*files, *more], key=lambda file: split_name(file.name)[1:])
    if not files:
        named = ", ".join(missing[:3]) or ".db3 or .mcap"
        raise ReadError(
            "bag_incomplete",
            f"{path.name} has {METADATA}, but none of the bag's files ({named}).",
            "Upload the whole folder of the bag.",
        )
    return files


def _has_part(files: Sequence[Path], part: Path) -> bool:
    """Whether a file is among others, packed or unpacked."""
    return any(part.name.removesuffix(".zstd") == file.name.removesuffix(".zstd") for file in files)


def read_metadata(metadata: Path) -> dict[str, Any]:
    """Read a bag's metadata, which have ``relative_file_paths``.

    Raises:
        ReadError: ``bag_incomplete``, the metadata cannot be read.
    """
    yaml: Any = import_module("yaml")
    try:
        if metadata.stat().st_size > _METADATA_BYTES:
            raise ValueError(f"{metadata.stat().st_size} bytes")
        loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # libyaml's is ten times faster
        document: Any = yaml.load(metadata.read_bytes(), Loader=loader)
        information: dict[str, Any] = document["rosbag2_bagfile_information"]
        iter(information["relative_file_paths"])
        return information
    except (yaml.YAMLError, KeyError, TypeError, ValueError, RecursionError) as error:
        why = (str(error).splitlines() or ["no list of files"])[0][:100]
        raise ReadError(
            "bag_incomplete",
            f"{METADATA} is not what a ROS 2 bag has ({why}).",
            "Run `ros2 bag reindex` on the folder, or upload the .db3 or .mcap file by itself.",
        ) from error
