"""Which pairs are held out together: blocks of time, or whole poses; never a frame beside its neighbours."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from apexcal.documents.folds import cut_folds, most_folds
from workers.solver.errors import SolveError

Integers = NDArray[np.int64]


class Fold(NamedTuple):
    """The pairs of one fold (ascending), and for each of them its block: blocks err together."""

    indices: Integers
    blocks: Integers


def folds(groups_or_stamps: ArrayLike, count: int) -> list[Fold]:
    """Folds that together hold every pair once; see :func:`apexcal.documents.folds.cut_folds`.

    groups_or_stamps (N,): time stamps (any unit), or a group per pair (a pose, a recording).
    Raises SolveError `bad_folds` where there are too few values: at least two per fold of stamps that are all
    different (else a fold would be a single frame), at least one group per fold.
    """
    values: NDArray[Any] = np.asarray(groups_or_stamps)
    if values.ndim != 1 or values.size == 0:
        raise SolveError("bad_folds", "There are no groups or stamps to make folds of.", "Give one for each pair.")
    if values.dtype.kind == "f" and not np.all(np.isfinite(values)):
        raise SolveError("bad_folds", "A stamp is not finite.", "")
    different = len(np.unique(values))
    if count < 2 or count > most_folds(different, values.size):
        raise SolveError(
            "bad_folds",
            f"{different} different {'stamps' if different == values.size else 'groups'} cannot make {count} folds.",
            "Ask for at least 2 folds, and for fewer than there are poses, or half as many as there are frames.",
        )
    cut = cut_folds(values.tolist(), count)
    fold, block = np.array(cut.fold, np.int64), np.array(cut.block, np.int64)
    taken = [np.flatnonzero(fold == index).astype(np.int64) for index in range(count)]
    return [Fold(indices, block[indices]) for indices in taken]
