"""A ROS 2 bag: one file, or a folder with metadata.yaml and its files, which becomes a tar."""

from __future__ import annotations

import tarfile
from collections.abc import Callable, Mapping
from contextlib import closing
from importlib import import_module
from pathlib import Path
from typing import Any, Final

from workers.readers.copying.editor import Editor
from workers.readers.copying.edits import EditCounts, Edits
from workers.readers.copying.mcap_copy import copy_mcap
from workers.readers.copying.sqlite_copy import copy_sqlite
from workers.readers.damage import damage
from workers.readers.detect import MCAP, read_head
from workers.readers.output import create
from workers.readers.ros.rosbag2 import METADATA, bag_files, read_metadata, unpacked_file
from workers.readers.trees.scratch import Scratch

_INFORMATION: Final = "rosbag2_bagfile_information"

OnDone = Callable[[float], None]


def copy_file(path: Path, out: Path, edits: Edits, on_done: OnDone) -> tuple[Path, EditCounts]:
    """Copy one file of a bag. Returns where it is, with its format's suffix, and what was done."""
    with closing(Scratch(path.name)) as scratch:
        copy, editor = _copy_one(path, out, edits, scratch, True, on_done)
    editor.check_complete()
    return copy, editor.counts


def copy_folder(folder: Path, out: Path, edits: Edits, on_done: OnDone) -> tuple[Path, EditCounts]:
    """Copy a bag's folder into a tar. New poses go into its first file with a message."""
    work = out.parent / f"{out.name}-files"
    work.mkdir()
    with closing(Scratch(folder.name)) as scratch:
        warnings: list[str] = []
        files = bag_files(folder, warnings)
        editors: list[Editor] = []
        copies: list[Path] = []
        for number, file in enumerate(files):
            name = file.name.removesuffix(".zstd").rpartition(".")[0]

            def on_part(share: float, number: int = number) -> None:
                on_done((number + share) / len(files))

            is_first = not any(editor.has_begun for editor in editors)
            copied, editor = _copy_one(file, work / name, edits, scratch, is_first, on_part)
            editors.append(editor)
            copies.append(copied)
        _check_all(editors)
        metadata = work / METADATA
        with create(metadata) as file:
            with damage(METADATA, "a ROS 2 bag's metadata", "Run `ros2 bag reindex` on the folder."):
                text = _metadata(read_metadata(folder / METADATA), copies, editors)
            file.write(text)
        return _packed([metadata, *copies], out), _summed(editors)


def _copy_one(
    path: Path, out: Path, edits: Edits, scratch: Scratch, is_first: bool, on_done: OnDone
) -> tuple[Path, Editor]:
    path = unpacked_file(path, scratch)
    is_mcap = read_head(path).startswith(MCAP)
    target = out.with_name(f"{out.name}.{'mcap' if is_mcap else 'db3'}")
    copy = copy_mcap if is_mcap else copy_sqlite
    return target, copy(path, target, edits, is_first, on_done)


def _check_all(editors: list[Editor]) -> None:
    """A pose may be stated in any of the files."""
    for editor in editors[1:]:
        editors[0].found_elsewhere(editor)
    editors[0].check_complete()


def _summed(editors: list[Editor]) -> EditCounts:
    counts = [editor.counts for editor in editors]
    return EditCounts(
        sum(count.copied for count in counts),
        sum(count.replaced for count in counts),
        sum(count.added for count in counts),
    )


def _metadata(stated: Mapping[str, Any], files: list[Path], editors: list[Editor]) -> bytes:
    """The bag's metadata with the new topics, counts and names; nothing is compressed as a whole any more."""
    yaml: Any = import_module("yaml")
    information: dict[str, Any] = dict(stated)
    added: dict[str, int] = {}
    for editor in editors:
        for topic, count in editor.added_by_topic.items():
            added[topic] = added.get(topic, 0) + count
    stated_topics: list[dict[str, Any]] = information.get("topics_with_message_count") or []
    listed: list[dict[str, Any]] = [dict(entry) for entry in stated_topics]
    by_name: dict[str, dict[str, Any]] = {entry["topic_metadata"]["name"]: entry for entry in listed}
    for name, count in added.items():
        if name in by_name:
            by_name[name]["message_count"] = int(by_name[name]["message_count"]) + count
    new = {topic.name: topic for editor in editors for topic in editor.new_topics}
    listed += [
        {"topic_metadata": topic.metadata, "message_count": added.get(topic.name, 0)}
        for topic in new.values()
        if topic.name not in by_name and added.get(topic.name)
    ]
    information |= {
        "relative_file_paths": [file.name for file in files],
        "topics_with_message_count": listed,
        "message_count": int(information.get("message_count", 0)) + sum(added.values()),
    }
    if information.get("compression_mode", "").lower() == "file":
        information |= {"compression_mode": "", "compression_format": ""}
    parts: list[dict[str, Any]] = information.get("files") or []
    if len(parts) == len(files):
        information["files"] = [
            {**part, "path": file.name, "message_count": int(part["message_count"]) + editor.counts.added}
            for part, file, editor in zip(parts, files, editors, strict=True)
        ]
    text: str = yaml.safe_dump({_INFORMATION: information}, sort_keys=False, allow_unicode=True)
    return text.encode()


def _packed(files: list[Path], out: Path) -> Path:
    archive_path = out.with_name(f"{out.name}.tar")
    with create(archive_path) as raw, tarfile.open(fileobj=raw, mode="w") as tar:
        for file in files:
            tar.add(file, arcname=f"bag/{file.name}")
    return archive_path
