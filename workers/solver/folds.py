"""Which pairs are held out together: whole blocks of time, or whole poses; never a frame beside its neighbours."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from apexcal.documents.pairs import most_blocks
from workers.solver.errors import SolveError


def folds(groups_or_stamps: ArrayLike, count: int) -> list[NDArray[np.int64]]:
    """Held-out index arrays (int64, ascending), one per fold, that together hold every pair once.

    groups_or_stamps (N,): time stamps (any unit), or a group per pair (a pose, a recording). Pairs of equal value
    stay together, and a fold is a run of neighbouring values: so blocks of time, or whole poses. The folds are cut
    where their numbers of pairs come out most equal.
    Raises SolveError `bad_folds` where there are too few values: at least two per fold of stamps that are all
    different (else a fold would be a single frame), at least one group per fold.
    """
    values: NDArray[Any] = np.asarray(groups_or_stamps)
    if values.ndim != 1 or values.size == 0:
        raise SolveError("bad_folds", "There are no groups or stamps to make folds of.", "Give one for each pair.")
    if values.dtype.kind == "f" and not np.all(np.isfinite(values)):
        raise SolveError("bad_folds", "A stamp is not finite.", "")
    _, group, sizes = np.unique(values, return_inverse=True, return_counts=True)
    single_frames = len(sizes) == values.size
    if count < 2 or count > most_blocks(len(sizes), values.size):
        raise SolveError(
            "bad_folds",
            f"{len(sizes)} different {'stamps' if single_frames else 'groups'} cannot make {count} folds.",
            "Ask for at least 2 folds, and for fewer than there are poses, or half as many as there are frames.",
        )
    fold_of_group = _cut(sizes.astype(np.int64), count, 2 if single_frames else 1)
    fold = fold_of_group[group]
    return [np.flatnonzero(fold == index).astype(np.int64) for index in range(count)]


def _cut(sizes: NDArray[np.int64], count: int, smallest: int) -> NDArray[np.int64]:
    # Cut the ordered groups where the running number of pairs comes nearest to k / count of all.
    ends = np.cumsum(sizes)
    total = int(ends[-1])
    fold = np.empty(len(sizes), dtype=np.int64)
    begin = 0
    for index in range(count):
        last = len(sizes) - smallest * (count - index - 1)
        wanted = total * (index + 1) / count
        end = begin + smallest
        while end < last and (index == count - 1 or abs(ends[end] - wanted) <= abs(ends[end - 1] - wanted)):
            end += 1
        fold[begin:end] = index
        begin = end
    return fold
