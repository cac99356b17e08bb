"""A folder or an archive as a recording: whatever bags, captures, videos, clouds and images it holds, together."""

from __future__ import annotations

import posixpath
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Final

from apexcal.documents.readings import ReadOptions
from workers.readers.captures.ouster.metadata import METADATA_BYTES, is_ouster_metadata
from workers.readers.captures.pcap import PcapRecording
from workers.readers.detect import HEAD_BYTES, MCAP, SQLITE, TREE, FileFormat, format_of
from workers.readers.recording import ReadError, Recording
from workers.readers.trees.archives import open_tree
from workers.readers.trees.cloud_files import is_bare_table, is_cloud_table
from workers.readers.trees.composite import Composite, TreePart
from workers.readers.trees.file_series import FileSeries
from workers.readers.trees.file_times import (
    CSV_NAME,
    KITTI_NAME,
    is_times_table,
    listed_times,
    stamp_series,
    strays,
    without_times,
)
from workers.readers.trees.file_tree import FileTree, read_file, read_head, refused
from workers.readers.trees.scratch import packing_of
from workers.readers.trees.series import Series, find_series, is_sensor_file
from workers.readers.trees.split_files import join_split

_BAG_FOLDER: Final = "metadata.yaml"
_BAG_FILES: Final = {".db3": SQLITE, ".mcap": MCAP}
# A write-ahead log beside an SQLite file, and its index.
_LOGS: Final = (".db3-wal", ".db3-shm")
_VIDEO: Final = "workers.readers.images.video"
_CAPTURE: Final = "workers.readers.captures.pcap"
# Of KITTI's raw layout. Beside `_KITTI_STARTS` the stamps are the moments at which the LiDAR looks ahead.
_KITTI_STARTS: Final = "timestamps_start.txt"
_TIMES: Final = frozenset({CSV_NAME, KITTI_NAME, _KITTI_STARTS, "timestamps_end.txt"})
_MAX_SOURCES: Final = 256
_MAX_METADATA: Final = 16  # each takes up to 25 MB once it is read
_MAX_LISTED: Final = 20


@dataclass(slots=True)
class TreeContents:
    """The sensors and other files of a tree.

    Attributes:
        sources: bags, captures and videos, files or folders, by path.
        series: sensors whose every message is a file.
        tables: paths of ``timestamps.csv`` and of others with its columns.
        metadata: paths of what Ouster sensors say of themselves.
        others: paths of what nobody reads.
    """

    sources: dict[str, FileFormat] = field(default_factory=dict[str, FileFormat])
    series: list[Series] = field(default_factory=list[Series])
    tables: list[str] = field(default_factory=list[str])
    metadata: list[str] = field(default_factory=list[str])
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
        self._warnings: list[str] = []
        parts: list[TreePart] = []
        try:
            contents = look_into(self._tree)
            if not contents.sources and not contents.series:
                raise _empty(self._tree, contents)
            _open_parts(self._tree, contents, options, parts, self._warnings)
            super().__init__(parts)
            listed = [f"{path} (not read)" for path in contents.others[:_MAX_LISTED]]
            if len(contents.others) > _MAX_LISTED:
                listed.append(f"{len(contents.others) - _MAX_LISTED} more files (not read)")
            self.other_topics = [*self.other_topics, *listed]
        except BaseException:
            for part in parts:
                part.recording.close()
            self._tree.close()
            raise

    @property
    def warnings(self) -> list[str]:
        """The files that were left out, and the parts' own warnings."""
        return [*self._warnings, *super().warnings]

    def close(self) -> None:
        """Close all that is open, and remove what was unpacked."""
        super().close()
        self._tree.close()


def look_into(tree: FileTree) -> TreeContents:
    """Find the contents of a tree by the files' names and first bytes."""
    contents = TreeContents()
    paths = tree.paths
    every = frozenset(paths)
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
            _look_inside(tree, path, contents, sensor_files, every)
    contents.series = find_series(sensor_files)
    is_lidar_open = not any(series.kind == "lidar" for series in contents.series)
    if is_lidar_open and all(format_.module == _VIDEO for format_ in contents.sources.values()):
        # Without another LiDAR, tables of numbers alone may be its points.
        bare = {path for path in contents.others if _is_bare(tree, path)}
        contents.others = [path for path in contents.others if path not in bare]
        contents.series = find_series([*sensor_files, *bare]) if bare else contents.series
    beside = {_table_beside(path) for path, format_ in contents.sources.items() if format_.module == _VIDEO}
    contents.others = [path for path in contents.others if path not in beside]
    if len(contents.sources) > _MAX_SOURCES:
        raise ReadError(
            "folder_refused",
            f"{tree.name} was refused: it holds {len(contents.sources)} bags, captures and videos; at most "
            f"{_MAX_SOURCES} are read.",
            "Upload each recording by itself.",
        )
    return contents


def _is_bare(tree: FileTree, path: str) -> bool:
    return path.lower().endswith(".csv") and is_bare_table(read_head(tree, path, HEAD_BYTES))


def _bag_folders(paths: Sequence[str]) -> Mapping[str, str]:
    """Folders of ROS 2 bags, each with one of its files."""
    every = set(paths)
    folders: dict[str, str] = {}
    for path in paths:
        folder, name = posixpath.split(path)
        plain = name.removesuffix(".zstd")
        if PurePosixPath(plain).suffix in _BAG_FILES and posixpath.join(folder, _BAG_FOLDER) in every:
            folders.setdefault(folder, path)
    return folders


def _bag_format(tree: FileTree, file: str) -> FileFormat:
    head = read_head(tree, file, HEAD_BYTES)
    format_ = format_of(head) or format_of(_BAG_FILES[PurePosixPath(file.removesuffix(".zstd")).suffix])
    if format_ is None:
        raise ReadError("not_a_recording", f"{file} is no ROS 2 bag.", "Look at what recorded it.")
    return format_


def _look_inside(
    tree: FileTree, path: str, contents: TreeContents, sensor_files: list[str], every: Collection[str]
) -> None:
    head = read_head(tree, path, HEAD_BYTES)
    format_ = format_of(head)
    plain = path.removesuffix(".zstd")
    if plain != path and PurePosixPath(plain).suffix in _BAG_FILES and packing_of(head) == "zstd":
        # `ros2 bag play` leaves the unpacked file beside the packed one.
        format_ = None if plain in every else format_of(_BAG_FILES[PurePosixPath(plain).suffix])
    if format_ is not None:
        contents.sources[path] = format_
    elif path.endswith(_LOGS) and path.rpartition("-")[0] in every:
        pass
    elif path.lower().endswith(".csv") and is_times_table(head):
        contents.tables.append(path)
    elif path.lower().endswith(".csv") and is_cloud_table(head):
        sensor_files.append(path)
    elif path.lower().endswith(".json") and is_ouster_metadata(read_head(tree, path, METADATA_BYTES)):
        contents.metadata.append(path)
        if len(contents.metadata) > _MAX_METADATA:
            raise refused(tree.name, f"it holds metadata of more than {_MAX_METADATA} Ouster sensors")
    else:
        contents.others.append(path)


def _open_parts(
    tree: FileTree, contents: TreeContents, options: ReadOptions, parts: list[TreePart], warnings: list[str]
) -> None:
    """Open all sources; ``parts`` holds what is open although one of them cannot be read."""
    every = frozenset(tree.paths)
    tables = {path: read_file(tree, path) for path in contents.tables}
    if beside := strays(contents.series, listed_times(tables)):
        contents.others += beside
        contents.series = find_series(
            [path for files in contents.series for path in files.paths if path not in beside]
        )
        listed = ", ".join(beside[:_MAX_LISTED])
        warnings.append(f"{listed}: left out, because the name is not like those of the sweeps or frames beside it.")
    top = _common_top([*contents.sources, *(f"{series.folder}/file" for series in contents.series)])
    for path, format_ in contents.sources.items():
        if format_.module == _VIDEO:
            recording = _open_video(tree, path, options, tables)
        elif format_.module == _CAPTURE:
            metadata = {name: read_file(tree, name) for name in contents.metadata}
            recording = PcapRecording(tree.on_disk(path), options, metadata)
        else:
            if f"{path}-wal" in every:
                tree.on_disk(f"{path}-wal")
            recording = format_.open(tree.on_disk(path), options)
        parts.append(TreePart(recording, _below(path, top)))
    for series in contents.series:
        series.name = _series_name(series, top)
    parts += _open_series(tree, contents.series, tables, options, parts, warnings)
    parts[:] = join_split(parts, options)


def _open_series(
    tree: FileTree,
    every: Sequence[Series],
    tables: Mapping[str, bytes],
    options: ReadOptions,
    parts: Sequence[TreePart],
    warnings: list[str],
) -> list[TreePart]:
    """The sensors whose messages are files; none where they have no times and the other sources suffice."""
    every_path = frozenset(tree.paths)
    kitti = {series.name: table for series in every if (table := _kitti_table(series, every_path))}
    try:
        stamp_series(every, tables, {name: read_file(tree, path) for name, path in kitti.items()})
        if parts and any(series.times_from == "index" for series in every):
            raise without_times(
                f"The files of {every[0].name} have no times, and {parts[0].label} has: nothing says which belong "
                "together."
            )
    except ReadError as error:
        kinds = {sensor.kind for part in parts for sensor in part.recording.sensors}
        if error.code != "files_without_times" or len(kinds) < 2:
            raise
        listed = ", ".join(series.name for series in every)
        warnings.append(f"{listed} were left out, because their files have no times.")
        return []
    if any(series.times_from == "index" for series in every):
        warnings.append(
            "File names hold numbers and no times: files of equal number are taken as simultaneous, and the times, "
            "0.1 s from number to number, are made up."
        )
    starts = {
        name for name, path in kitti.items() if posixpath.join(posixpath.dirname(path), _KITTI_STARTS) in every_path
    }
    return [
        TreePart(FileSeries(tree, files, options, looks_ahead=files.name in starts), ".", named=True)
        for files in every
    ]


def _kitti_table(series: Series, every_path: Collection[str]) -> str | None:
    """KITTI's table of times, which stands beside the files or beside their folder ``data``."""
    folder = PurePosixPath(series.folder)
    parents = (folder, folder.parent) if folder.name == "data" else (folder,)
    return next((path for parent in parents if (path := (parent / KITTI_NAME).as_posix()) in every_path), None)


def _open_video(tree: FileTree, path: str, options: ReadOptions, tables: Mapping[str, bytes]) -> Recording:
    from workers.readers.images.video import VideoRecording

    beside = _table_beside(path)
    times = read_file(tree, beside) if beside in set(tree.paths) else None
    start_ns = listed_times(tables).get(path)
    return VideoRecording(tree.on_disk(path), options, times=times, start_ns=start_ns, name=path)


def _table_beside(video: str) -> str:
    return f"{posixpath.splitext(video)[0]}.csv"


def _common_top(paths: Sequence[str]) -> str:
    return posixpath.commonpath([posixpath.dirname(path) or "." for path in paths]) if paths else ""


def _below(path: str, top: str) -> str:
    """A name without the folders that all have in common; its last part where nothing would remain."""
    if top and path.startswith(f"{top}/"):
        return path[len(top) + 1 :]
    return posixpath.basename(path) if path == top else path


def _series_name(series: Series, top: str) -> str:
    if series.name == top:
        return "images" if series.kind == "camera" else "clouds"
    return _below(series.name, top)


def _empty(tree: FileTree, contents: TreeContents) -> ReadError:
    contents_listed = f"; it holds {', '.join(contents.others[:5])}" if contents.others else ""
    packed = next((path for path in contents.others[:100] if TREE.matches(read_head(tree, path, HEAD_BYTES))), None)
    if packed is not None:
        return ReadError(
            "folder_empty",
            f"{tree.name} holds only {packed}, another archive.",
            f"Unpack it once and upload {posixpath.basename(packed)}, or the folder that is in it.",
        )
    return ReadError(
        "folder_empty",
        f"{tree.name} holds no recording, no point clouds and no images{contents_listed}.",
        "Put a bag, a packet capture or point clouds (.pcd, .ply, .bin, .npy, .csv) into it, and images (.jpg, .png, "
        ".webp) or a video, one subfolder per sensor or all in one.",
    )
