"""A recording's own file with its calibration put in: ROS 1 and ROS 2 bags and MCAP, bare or in an archive."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

from workers.readers.copying.edits import EditCounts, Edits
from workers.readers.copying.mcap_copy import copy_mcap
from workers.readers.copying.rosbag1_copy import copy_rosbag1
from workers.readers.copying.rosbag2_copy import copy_rosbag2
from workers.readers.detect import MCAP, ROSBAG1, SQLITE, read_head
from workers.readers.output import bytes_written
from workers.readers.recording import ReadError
from workers.readers.trees.archives import open_tree
from workers.readers.trees.folder import look_into


def copy_recording(
    path: Path, out_dir: Path, request: Mapping[str, Any], on_share: Callable[[float], None]
) -> dict[str, Any]:
    """Write the copy into a folder. Returns its ``file`` name and how many messages were copied, replaced and added.

    Raises:
        ReadError: ``copy_not_possible``, ``frame_moves``, and what the file's reader raises.
    """
    edits = Edits.from_json(request)
    out_dir.mkdir(parents=True, exist_ok=True)
    copy, counts = _copied(path, out_dir / "recording", edits, on_share)
    figures = {"copied": counts.copied, "replaced": counts.replaced, "added": counts.added}
    return {"file": copy.name, **figures, "written": bytes_written()}


def _copied(path: Path, out: Path, edits: Edits, on_done: Callable[[float], None]) -> tuple[Path, EditCounts]:
    head = b"" if path.is_dir() else read_head(path)
    if path.is_dir() or head.startswith(SQLITE):
        return copy_rosbag2(path, out, edits, on_done)
    if head.startswith(ROSBAG1):
        copy = out.with_name(f"{out.name}.bag")
        return copy, copy_rosbag1(path, copy, edits, on_done)
    if head.startswith(MCAP):
        copy = out.with_name(f"{out.name}.mcap")
        return copy, copy_mcap(path, copy, edits, on_done)
    with closing(open_tree(path)) as tree:
        contents = look_into(tree)
        sources = list(contents.sources)
        if len(sources) != 1 or contents.series:
            raise _refused(path, "holds not one bag but several files of sensors")
        inner = tree.on_disk(sources[0])
        if not inner.is_dir() and not read_head(inner).startswith((ROSBAG1, SQLITE, MCAP)):
            raise _refused(path, "holds no bag and no MCAP file")
        return _copied(inner, out, edits, on_done)


def _refused(path: Path, why: str) -> ReadError:
    return ReadError(
        "copy_not_possible",
        f"{path.name} {why}.",
        "Only ROS bags and MCAP files with ROS messages are copied. `apexcal export --format ros2` writes files "
        "to play beside it.",
    )
