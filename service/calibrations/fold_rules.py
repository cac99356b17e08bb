"""How many blocks can honestly be held out: whole poses or blocks of time, and enough pairs left to fit.

The workers cut the blocks (``workers/solver/folds.py``); a contract test holds these counts to what they can cut.
"""

from __future__ import annotations

from collections import Counter
from math import ceil

from service.db.base import Json


def fold_count(pairs: Json, wanted: int, free_parameters: int, what: str) -> tuple[int, str | None]:
    """The number of folds for these pairs, at most ``wanted``, and a sentence where it is another one.

    ``pairs`` is a set's object of columns; ``what`` names the fit in the sentence.
    """
    if wanted == 0:
        return 0, None
    values = pairs.get("group") or pairs.get("stamp_ns") or range(len(pairs["x"]))
    sizes = Counter(values)
    total = sum(sizes.values())
    # A block of single frames needs at least two of them, else a frame is held out beside its neighbours.
    single = len(sizes) == total
    most = min(wanted, len(sizes) // 2 if single else len(sizes))
    if most < 2:
        return 0, f"Nothing is held out of {what}: {len(sizes)} frames or poses make no two blocks."
    largest = min(ceil(total / most) + max(sizes.values()), total)
    if total - largest < free_parameters:
        return 0, (
            f"Nothing is held out of {what}: without a block of {largest} of the {total} pairs there are too few for "
            f"{free_parameters} free parameters."
        )
    if most < wanted:
        return (
            most,
            f"{most} blocks instead of {wanted} are held out of {what}: there are {len(sizes)} frames or poses.",
        )
    return most, None
