"""How many blocks (whole poses or blocks of time) can be held out with enough pairs left to fit.

The workers cut the blocks (``workers/solver/folds.py``).
"""

from __future__ import annotations

from collections import Counter
from math import ceil

from apexcal.documents.pairs import held_together, most_blocks
from service.db.base import Json


def fold_count(pairs: Json, wanted: int, free_parameters: int, what: str) -> tuple[int, str | None]:
    """The number of folds for these pairs, at most ``wanted``, and a sentence where it is another one.

    ``pairs`` is a set's object of columns; ``what`` names the fit in the sentence.
    """
    if wanted == 0:
        return 0, None
    sizes = Counter(held_together(pairs))
    total = sum(sizes.values())
    most = min(wanted, most_blocks(len(sizes), total))
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
