"""Into how many folds a camera's pairs are cut."""

from __future__ import annotations

import pytest

from service.calibrations import fold_rules
from service.calibrations.fold_rules import fold_count

WALK = {"x": [0.0] * 40, "stamp_ns": list(range(40))}


@pytest.mark.parametrize("free", [0, 4])
def test_one_fold_is_none(free):
    """Workers cut two folds or more: one would hold out all pairs. Nothing is free where all is locked."""
    assert fold_count(WALK, 1, {"pinhole": free}, "front")[0] == {"pinhole": 2}


def test_folds_are_cut_only_until_there_are_enough(monkeypatch):
    """To cut 100,000 pairs into each number of folds takes a second, and the request waits for it."""
    cut: list[int] = []

    def counted(values, count):
        cut.append(count)
        return cut_folds(values, count)

    cut_folds = fold_rules.cut_folds
    monkeypatch.setattr(fold_rules, "cut_folds", counted)
    assert fold_count(WALK, 5, {"pinhole": 10}, "front") == ({"pinhole": 5}, [])
    assert cut == [20, 5]
