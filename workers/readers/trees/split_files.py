"""Bags that were split while they were recorded: which files are parts of one, and in which order."""

from __future__ import annotations

import posixpath
import re
from collections.abc import Sequence
from importlib import import_module
from pathlib import PurePosixPath
from typing import Final

from apexcal.documents.readings import ReadOptions
from workers.readers.trees.composite import TreePart
from workers.readers.trees.series import stem_and_number

# As `rosbag record` and people write the moment at which a file was begun.
_DATE: Final = re.compile(r"(?:19|20)\d\d[-_.]?[01]\d[-_.]?[0-3]\d[-_.T]?[0-2]\d[-_.]?[0-5]\d[-_.]?[0-5]\d")


def split_name(path: str) -> tuple[str, tuple[str, ...], int]:
    """A bag's file name: what all its parts have in common, their dates, and the part's number, -1 without one.

    ``walk_2.db3.zstd`` gives (``walk_``, (), 2); of ``2024-05-01-10-00-00_2.bag`` each part has a date of its own.
    """
    name = PurePosixPath(path).name.removesuffix(".zstd")
    stem, number = stem_and_number(_DATE.sub("", name))
    return stem, tuple(_DATE.findall(name)), int(number) if number.isdigit() and len(number) < 10 else -1


def join_split(parts: Sequence[TreePart], options: ReadOptions) -> list[TreePart]:
    """Bags that were split while they were recorded (``walk_0.bag``, ``walk_1.bag``) as one.

    A topic may begin in a later file: the files have some topics in common, and rising numbers.
    """
    joined: list[list[TreePart]] = []
    for part in sorted(parts, key=lambda part: split_name(part.label)):
        last = joined[-1] if joined else []
        if last and _goes_on(last[-1], part) and any(_topics(each) & _topics(part) for each in last):
            last.append(part)
        else:
            joined.append([part])
    joined.sort(key=lambda group: parts.index(group[0]))
    return [group[0] if len(group) == 1 else _joined(group, options) for group in joined]


def _joined(group: Sequence[TreePart], options: ReadOptions) -> TreePart:
    split = import_module("workers.readers.ros.split_bag").SplitBag([part.recording for part in group], options)
    return TreePart(split, group[0].label)


def _goes_on(before: TreePart, part: TreePart) -> bool:
    (stem, _, number), (other, _, following) = split_name(before.label), split_name(part.label)
    places = [(posixpath.dirname(each.label), each.recording.format) for each in (before, part)]
    return 0 <= number < following and stem == other and places[0] == places[1]


def _topics(part: TreePart) -> frozenset[tuple[str, str]]:
    return frozenset((s.kind, s.name) for s in part.recording.sensors if s.name.startswith("/"))
