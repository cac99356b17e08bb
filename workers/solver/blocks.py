"""Blocks of pairs that may share errors: groups (a pose of a still board, a sweep), and pairs near in time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
BlockKind = Literal["group", "time", "order"]
STRETCHES: Final = 8
"""Time blocks of a walk, every second of which is a half."""
LEAST_PAIRS: Final = 40
"""Fewer pairs or groups do not tell how long errors last."""


@dataclass(frozen=True, eq=False)
class Blocks:
    """Labels (N,) of the pairs' groups, or of the time blocks if there are no groups, from 0 in the order of time.

    kind: `group`, what the pairs themselves name; `time`, `order`: there are no groups. moments (N,): of the pairs,
    or of their groups' beginnings, by their stamps (s) or their places; None if there are too few.
    """

    labels: Indices
    kind: BlockKind
    moments: Floats | None = None

    def taken(self, rows: Indices) -> Blocks:
        """Return the blocks of the pairs at these rows."""
        return Blocks(_numbered(self.labels[rows]), self.kind, None if self.moments is None else self.moments[rows])

    @property
    def over_time(self) -> bool:
        """Whether errors may last from one pair or group to the next."""
        return self.moments is not None

    @property
    def halves(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return two splits (N,): every second block or group, and the earlier ones; true for the first half."""
        labels = self.labels if self.moments is None else _stretches(self.moments)
        count = int(labels.max()) + 1
        return labels % 2 == 0, labels < (count + 1) // 2


def blocks_of(pairs: Mapping[str, Sequence[Any]]) -> Blocks | None:
    """The blocks of a correspondence set's pairs (columns); None where they are too few to be cut.

    Groups of a single pair each are no blocks.
    """
    count = len(pairs["x"])
    group, stamps = pairs.get("group"), pairs.get("stamp_ns")
    ranked = np.arange(count) if stamps is None else np.asarray(stamps, np.int64)
    moments = (ranked - ranked.min(initial=0 if stamps is None else ranked[0])) * (1.0 if stamps is None else 1e-9)
    if group is not None:
        first = {value: row for row, value in reversed(list(enumerate(group)))}
        if 1 < len(first) < count:
            index = {value: label for label, value in enumerate(sorted(first, key=first.__getitem__))}
            labels = np.array([index[value] for value in group], np.int64)
            begins = np.full(len(first), np.inf)
            np.minimum.at(begins, labels, moments)
            return Blocks(labels, "group", begins[labels] if len(np.unique(begins)) >= LEAST_PAIRS else None)
    if count < LEAST_PAIRS or len(np.unique(moments)) < STRETCHES:
        return None
    return Blocks(_stretches(moments), "order" if stamps is None else "time", moments)


def _stretches(moments: Floats) -> Indices:
    """Labels of time blocks of equal numbers of pairs; those of one moment stay together."""
    rank = np.searchsorted(np.sort(moments), moments)
    return _numbered(rank * STRETCHES // len(moments))


def _numbered(labels: Indices) -> Indices:
    return np.unique(labels, return_inverse=True)[1].astype(np.int64)
