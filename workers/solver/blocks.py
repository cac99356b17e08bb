"""Blocks of pairs whose errors may be shared: the poses of a still board, or stretches of a walk."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

Indices = NDArray[np.int64]
BlockKind = Literal["group", "time", "order"]
STRETCHES: Final = 8
"""Time blocks of a walk. Of 8, 12, 16, 24 and 36 this number covered best if errors last for 8 or 25 of 222 pairs, or
half of the walk (docs/uncertainty.md)."""
SHORTER: Final = (24, 60)
"""Numbers of shorter time blocks. They cover better if a thousand vertices' errors last for a second or two."""
_PAIRS_A_BLOCK: Final = 5
LEAST_PAIRS: Final = _PAIRS_A_BLOCK * STRETCHES
"""Fewer pairs without groups are not cut: a stretch would have hardly more pairs than shared unknowns."""


@dataclass(frozen=True, eq=False)
class Blocks:
    """Labels (N,) of the pairs' blocks, from 0 in the order of time (or of the pairs), and the kind of the blocks.

    `group`: what the pairs themselves name. `time`, `order`: stretches of equal numbers of pairs, by their stamps or
    by their places. shorter: labels of larger numbers of such blocks. stretches: labels (N,) of the stretches of a
    walk with many groups, such as sweeps with four corners each. A group lies whole in one stretch. None if there are
    fewer groups than LEAST_PAIRS.
    """

    labels: Indices
    kind: BlockKind
    stretches: Indices | None = None
    shorter: tuple[Indices, ...] = ()

    def taken(self, rows: Indices) -> Blocks:
        """Those of the pairs at these rows."""
        stretches = None if self.stretches is None else _numbered(self.stretches[rows])
        shorter = tuple(_numbered(labels[rows]) for labels in self.shorter)
        return Blocks(_numbered(self.labels[rows]), self.kind, stretches, shorter)

    @property
    def over_time(self) -> bool:
        """Whether there are stretches, alone or of groups."""
        return self.kind != "group" or self.stretches is not None

    @property
    def halves(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Every second stretch or group, and the earlier half of them: (N,) each, true for the first half."""
        labels = self.labels if self.stretches is None else self.stretches
        count = int(labels.max()) + 1
        return labels % 2 == 0, labels < (count + 1) // 2


def blocks_of(pairs: Mapping[str, Sequence[Any]]) -> Blocks | None:
    """The blocks of a correspondence set's pairs (columns); None where they are too few to be cut.

    Groups of a single pair each are no blocks. LEAST_PAIRS groups or more are also cut into stretches.
    """
    count = len(pairs["x"])
    group, stamps = pairs.get("group"), pairs.get("stamp_ns")
    ranked = np.arange(count) if stamps is None else np.asarray(stamps, np.int64)
    if group is not None:
        first = {value: row for row, value in reversed(list(enumerate(group)))}
        if 1 < len(first) < count:
            index = {value: label for label, value in enumerate(sorted(first, key=first.__getitem__))}
            labels = np.array([index[value] for value in group], np.int64)
            return Blocks(labels, "group", _stretches_of_groups(labels, ranked))
    if count < LEAST_PAIRS:
        return None
    labels = _stretches(ranked)
    shorter = tuple(_stretches(ranked, blocks) for blocks in SHORTER if count >= _PAIRS_A_BLOCK * blocks)
    return Blocks(labels, "order" if stamps is None else "time", None, shorter) if labels.max() > 0 else None


def _stretches_of_groups(labels: Indices, ranked: Indices) -> Indices | None:
    count = int(labels.max()) + 1
    if count < LEAST_PAIRS:
        return None
    begins = np.full(count, np.iinfo(np.int64).max)
    np.minimum.at(begins, labels, ranked)
    stretches = _stretches(begins)
    return stretches[labels] if stretches.max() > 0 else None


def _stretches(ranked: Indices, count: int = STRETCHES) -> Indices:
    """Labels of equal numbers of things in the order of `ranked`. Those of one moment stay together."""
    order = np.argsort(ranked, kind="stable")
    in_order = ranked[order]
    rank = np.empty(len(ranked), np.int64)
    rank[order] = np.searchsorted(in_order, in_order)
    return _numbered(rank * count // len(ranked))


def _numbered(labels: Indices) -> Indices:
    return np.unique(labels, return_inverse=True)[1].astype(np.int64)
