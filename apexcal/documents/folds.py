"""Folds of held-out pairs: whole blocks of time or whole poses, in turn. Service and workers cut alike."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import accumulate
from typing import Any, Final, NamedTuple

# Blocks of each fold. With one block, a whole part of the walk would be extrapolated. The more blocks, the more
# frames lie beside fitted neighbours.
ROUNDS: Final = 4


class FoldCut(NamedTuple):
    """The fold that holds out each pair, and the block of neighbours that is held out with it."""

    fold: list[int]
    block: list[int]

    def largest(self) -> int:
        """The number of pairs in the largest fold."""
        return max(Counter(self.fold).values())


def most_folds(different: int, pairs: int) -> int:
    """The largest number of folds for pairs with so many different values.

    A fold of single frames needs at least two of them: one frame alone would be held out beside fitted neighbours.
    """
    return different // 2 if different == pairs else different


def cut_folds(values: Sequence[Any], count: int) -> FoldCut:
    """The folds of pairs with these values: stamps, or groups. ``count`` is at most `most_folds` of them.

    Pairs of equal value stay together. The values are cut in their order into up to `ROUNDS` blocks for each fold,
    with numbers of pairs as equal as possible, and the folds take turns. So fitted pairs surround each block, and no
    fit has to extrapolate to the pairs that judge it.
    """
    sizes = Counter(values)
    ordered = sorted(sizes)
    # If few values have several pairs, the values are frames, not poses.
    smallest = 2 if 2 * len(sizes) > len(values) and len(sizes) >= 2 * count else 1
    blocks = count * min(ROUNDS, len(sizes) // (smallest * count))
    block_of = _cut([sizes[value] for value in ordered], blocks, smallest)
    pairs_of_block = [0] * blocks
    for value, block in zip(ordered, block_of, strict=True):
        pairs_of_block[block] += sizes[value]
    fold_of = _take_turns(pairs_of_block, count)
    of_value = dict(zip(ordered, block_of, strict=True))
    block = [of_value[value] for value in values]
    return FoldCut([fold_of[number] for number in block], block)


def _cut(sizes: Sequence[int], count: int, smallest: int) -> list[int]:
    """The block of each value. Cuts are where the running number of pairs is nearest to k / count of all."""
    ends = list(accumulate(sizes))
    block: list[int] = []
    for index in range(count):
        last = len(sizes) - smallest * (count - index - 1)
        target = ends[-1] * (index + 1) / count
        end = len(block) + smallest
        while end < last and (index == count - 1 or abs(ends[end] - target) <= abs(ends[end - 1] - target)):
            end += 1
        block += [index] * (end - len(block))
    return block


def _take_turns(sizes: Sequence[int], count: int) -> list[int]:
    """The fold of each block. Neighbours go to different folds, the largest to the fold with the fewest pairs.

    If all blocks are equal, the order shifts from round to round: without that, a walk with as many lanes as folds
    would give each fold a lane of its own.
    """
    shift = 2 if count > 3 else count - 2
    pairs_of_fold = [0] * count
    fold_of = [0] * len(sizes)
    for first in range(0, len(sizes), count):
        part = sorted(range(first, min(first + count, len(sizes))), key=lambda block: -sizes[block])
        turn = [(fold - shift * (first // count)) % count for fold in range(count)]
        order = sorted(range(count), key=lambda fold: (pairs_of_fold[fold], turn[fold]))
        for block, fold in zip(part, order, strict=False):
            fold_of[block] = fold
            pairs_of_fold[fold] += sizes[block]
    return fold_of
