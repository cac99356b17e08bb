"""How many folds (blocks of time, or whole poses) a camera's pairs are held out in, the same for all its models."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from apexcal.documents.folds import cut_folds, most_folds
from apexcal.documents.pairs import held_together
from service.platform.db.base import Json

# The most that a request may ask for.
_MOST: Final = 20


def fold_count(pairs: Json, folds: int, free: Mapping[str, int], camera: str) -> tuple[dict[str, int], list[str]]:
    """For each model the number of folds, and sentences where it is not ``folds``.

    Models are compared on the same held-out pairs, so all that can be judged get the same number: the lowest one,
    from ``folds`` on, that leaves each model at least as many pairs as it has free parameters. ``pairs`` is a set's
    object of columns; ``free`` the number of free parameters by model.
    """
    none = dict.fromkeys(free, 0)
    if folds == 0:
        return none, []
    values = held_together(pairs)
    total, different = len(values), len(set(values))
    most = min(_MOST, most_folds(different, total))
    if most < 2:
        return none, [f"Nothing is held out of {camera}: {different} frames or poses are too few for two blocks."]
    remain = _remaining(values, most)
    judged = {model: number for model, number in free.items() if remain >= number}
    sentences = [
        f"Nothing is held out of {model} on {camera}: with {most} folds {remain} of the {total} pairs remain for "
        f"{number} free parameters. {_more(total, remain, number)}"
        for model, number in free.items()
        if model not in judged
    ]
    if not judged:
        return none, sentences
    # One after the other: to cut 100,000 pairs takes 50 ms.
    largest = max(judged.values())
    fewer = range(max(2, min(folds, most)), most)
    count = next((count for count in fewer if _remaining(values, count) >= largest), most)
    if count != folds:
        because = (
            f"there are {different} frames or poses"
            if count < folds
            else f"with {folds} too few pairs would remain to fit the largest model"
        )
        sentences.append(f"{count} folds instead of {folds} are held out of {camera}: {because}.")
    return none | dict.fromkeys(judged, count), sentences


def _remaining(values: Sequence[Any], count: int) -> int:
    """How many pairs remain to fit without the largest fold."""
    return len(values) - cut_folds(values, count).largest()


def _more(total: int, left: int, free: int) -> str:
    """How many more pairs are needed, if the same share of them remains."""
    needed = -(-free * total // max(left, 1)) - total
    return f"About {needed} more {'pair' if needed == 1 else 'pairs'} would do."
