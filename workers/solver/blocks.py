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
"""Stretches of a walk. Of 8, 12, 16, 24 and 36 this number covered best if errors last for 8 or 25 of 222 pairs, or
half of the walk (decision 0044)."""
LEAST_PAIRS: Final = 5 * STRETCHES
"""Fewer pairs without groups are not cut: a stretch would have hardly more pairs than shared unknowns."""


@dataclass(frozen=True, eq=False)
class Blocks:
    """Labels (N,) of the pairs' blocks, from 0 in the order of time (or of the pairs), and the kind of the blocks.

    `group`: what the pairs themselves name. `time`, `order`: stretches of equal numbers of pairs, by their stamps or
    by their places.
    """

    labels: Indices
    kind: BlockKind

    def taken(self, rows: Indices) -> Blocks:
        """Those of the pairs at these rows."""
        return Blocks(_numbered(self.labels[rows]), self.kind)

    @property
    def halves(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Every second block, and the earlier half of the blocks: (N,) each, true for the first of the two halves."""
        count = int(self.labels.max()) + 1
        return self.labels % 2 == 0, self.labels < (count + 1) // 2


def blocks_of(pairs: Mapping[str, Sequence[Any]]) -> Blocks | None:
    """The blocks of a correspondence set's pairs (columns); None where they are too few to be cut.

    Groups of a single pair each are no blocks.
    """
    count = len(pairs["x"])
    group = pairs.get("group")
    if group is not None:
        first = {value: row for row, value in reversed(list(enumerate(group)))}
        if 1 < len(first) < count:
            place = {value: label for label, value in enumerate(sorted(first, key=first.__getitem__))}
            return Blocks(np.array([place[value] for value in group], np.int64), "group")
    if count < LEAST_PAIRS:
        return None
    stamps = pairs.get("stamp_ns")
    ranked = np.arange(count) if stamps is None else np.asarray(stamps, np.int64)
    order = np.argsort(ranked, kind="stable")
    in_order = ranked[order]
    # Pairs of one moment stay together.
    rank = np.empty(count, np.int64)
    rank[order] = np.searchsorted(in_order, in_order)
    labels = _numbered(rank * STRETCHES // count)
    return Blocks(labels, "order" if stamps is None else "time") if labels.max() > 0 else None


def _numbered(labels: Indices) -> Indices:
    return np.unique(labels, return_inverse=True)[1].astype(np.int64)
