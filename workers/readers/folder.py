"""A folder or an archive as a recording: whatever bags, captures, videos, clouds and images it holds, together."""

from __future__ import annotations

import posixpath
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath
from typing import Final

from workers.readers.cloud_files import is_cloud_table
from workers.readers.composite import Composite, Part
from workers.readers.detect import HEAD_BYTES, Format, format_of
from workers.readers.file_series import FileSeries, Group, group_files, is_sensor_file
from workers.readers.file_times import CSV_NAME, KITTI_NAME, listed_times
from workers.readers.file_tree import FileTree, read_file, read_head
from workers.readers.kitti import KITTI_ENDS, KITTI_STARTS
from workers.readers.open_tree import open_tree
from workers.readers.recording import ReadError, ReadOptions, Recording

_BAG_FOLDER: Final = "metadata.yaml"
_BAG_FILES: Final = {".db3": b"SQLite format 3\0", ".mcap": b"\x89MCAP0\r\n"}
_VIDEO: Final = "workers.readers.video"
_TIMES: Final = frozenset({CSV_NAME, KITTI_NAME, KITTI_STARTS, KITTI_ENDS})
_MAX_SOURCES: Final = 256
_MAX_LISTED: Final = 20


@dataclass(slots=True)
class _Contents:
    """What a tree holds.

    Attributes:
        sources: bags, captures and videos, files or folders, by path.
        groups: sensors whose every message is a file.
        tables: paths of ``timestamps.csv``.
        others: paths of what nobody reads.
    """

    sources: dict[str, Format] = field(default_factory=dict[str, Format])
    groups: list[Group] = field(default_factory=list[Group])
    tables: list[str] = field(default_factory=list[str])
    others: list[str] = field(default_factory=list[str])


class FolderRecording(Composite):
    """Everything in a folder, a tar or a zip that is a sensor.

    Raises:
        ReadError: ``folder_empty``, ``folder_refused``, ``recording_truncated``, ``archive_encrypted``,
            ``archive_expands``, ``files_without_times``, ``timestamps_incomplete``, ``timestamps_malformed``, and
            what the readers of the files in it raise.
    """

    def __init__(self, path: Path, options: ReadOptions) -> None:
        self._tree = open_tree(path)
        self._others: list[str] = []
        parts: list[Part] = []
        try:
            contents = _look(self._tree)
            self._others = contents.others
            if not contents.sources and not contents.groups:
                raise _empty(self._tree, contents)
            _open_parts(self._tree, contents, options, parts)
            super().__init__(parts)
        except BaseException:
            for part in parts:
                part.recording.close()
            self._tree.close()
            raise

    @property
    def other_topics(self) -> Sequence[str]:
        """What the files in it hold besides, and the files that nobody reads."""
        listed = [f"{path} (not read)" for path in self._others[:_MAX_LISTED]]
        if len(self._others) > _MAX_LISTED:
            listed.append(f"{len(self._others) - _MAX_LISTED} more files (not read)")
        return [*super().other_topics, *listed]

    def close(self) -> None:
        """Close all that is open, and remove what was unpacked."""
        super().close()
        self._tree.close()


def _look(tree: FileTree) -> _Contents:
    contents = _Contents()
    paths = tree.paths
    bags = _bag_folders(paths)
    sensor_files: list[str] = []
    for path in paths:
        folder, name = posixpath.split(path)
        if folder in bags:
            if name == _BAG_FOLDER:
                contents.sources[folder or "."] = _bag_format(tree, bags[folder])
        elif name == CSV_NAME:
            contents.tables.append(path)
        elif is_sensor_file(path):
            sensor_files.append(path)
        elif name not in _TIMES:
            _look_inside(tree, path, contents, sensor_files)
    contents.groups = group_files(sensor_files)
    if len(contents.sources) > _MAX_SOURCES:
        raise ReadError(
            "folder_refused",
            f"{tree.name} was refused: it holds {len(contents.sources)} bags, captures and videos; at most "
            f"{_MAX_SOURCES} are read.",
            "Upload each recording by itself.",
        )
    return contents


def _bag_folders(paths: Sequence[str]) -> Mapping[str, str]:
    """Folders of ROS 2 bags, each with one of its files."""
    known = set(paths)
    found: dict[str, str] = {}
    for path in paths:
        folder, name = posixpath.split(path)
        plain = name.removesuffix(".zstd")
        if PurePosixPath(plain).suffix in _BAG_FILES and posixpath.join(folder, _BAG_FOLDER) in known:
            found.setdefault(folder, path)
    return found


def _bag_format(tree: FileTree, file: str) -> Format:
    head = read_head(tree, file, HEAD_BYTES)
    known = format_of(head) or format_of(_BAG_FILES[PurePosixPath(file.removesuffix(".zstd")).suffix])
    if known is None:
        raise ReadError("not_a_recording", f"{file} is no ROS 2 bag.", "Look at what recorded it.")
    return known


def _look_inside(tree: FileTree, path: str, contents: _Contents, sensor_files: list[str]) -> None:
    head = read_head(tree, path, HEAD_BYTES)
    known = format_of(head)
    if known is not None:
        contents.sources[path] = known
    elif path.lower().endswith(".csv") and is_cloud_table(head):
        sensor_files.append(path)
    else:
        contents.others.append(path)


def _open_parts(tree: FileTree, contents: _Contents, options: ReadOptions, parts: list[Part]) -> None:
    tables = {path: read_file(tree, path) for path in contents.tables}
    top = _common_top([*contents.sources, *(f"{group.folder}/file" for group in contents.groups)])
    for path, known in contents.sources.items():
        if known.module == _VIDEO:
            recording = _open_video(tree, path, options, tables)
        else:
            recording = known.open(tree.on_disk(path), options)
        parts.append(Part(recording, _below(path, top)))
    if contents.groups:
        groups = [replace(group, name=_below(group.name, top)) for group in contents.groups]
        series = FileSeries(tree, groups, tables, options)
        parts.append(Part(series, ".", named=True))
        if "index" in series.times_from and contents.sources:
            raise ReadError(
                "files_without_times",
                f"The files of {groups[0].name} have numbers and no times, while {next(iter(contents.sources))} has "
                "times: which belong together is not said.",
                f"Name the files by their time (1600000000123456789.png), or add {CSV_NAME} with file,stamp_ns.",
            )


def _open_video(tree: FileTree, path: str, options: ReadOptions, tables: Mapping[str, bytes]) -> Recording:
    from workers.readers.video import VideoRecording

    beside = f"{path.rpartition('.')[0]}.csv"
    times = read_file(tree, beside) if beside in set(tree.paths) else None
    start_ns = listed_times(tables).get(path)
    return VideoRecording(tree.on_disk(path), options, times=times, start_ns=start_ns, name=path)


def _common_top(paths: Sequence[str]) -> str:
    return posixpath.commonpath([posixpath.dirname(path) or "." for path in paths]) if paths else ""


def _below(path: str, top: str) -> str:
    """A name without the folders that all have in common; its last part where nothing would remain."""
    if top and path.startswith(f"{top}/"):
        return path[len(top) + 1 :]
    return posixpath.basename(path) if path == top else path


def _empty(tree: FileTree, contents: _Contents) -> ReadError:
    found = f"; it holds {', '.join(contents.others[:5])}" if contents.others else ""
    return ReadError(
        "folder_empty",
        f"{tree.name} holds no recording, no point clouds and no images{found}.",
        "Put a bag, a packet capture or point clouds (.pcd, .bin, .npy, .csv) into it, and images (.jpg, .png, "
        ".webp) or a video, one subfolder per sensor or all in one.",
    )
