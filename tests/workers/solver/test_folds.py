from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from workers.solver.errors import SolveError
from workers.solver.folds import folds


@given(st.lists(st.integers(0, 8), min_size=30, max_size=80), st.integers(2, 3))
def test_groups_stay_whole_and_every_pair_is_held_out_once(groups, count):
    if len(set(groups)) < count:
        groups = [*groups, 20, 21, 22]
    held_out = folds(groups, count)
    assert len(held_out) == count
    np.testing.assert_array_equal(np.sort(np.concatenate(held_out)), np.arange(len(groups)))
    members = [set(np.array(groups)[fold]) for fold in held_out]
    assert all(len(fold) > 0 for fold in held_out)
    for i, one in enumerate(members):
        assert all(one.isdisjoint(other) for other in members[i + 1 :])


def test_stamps_make_blocks_of_time():
    stamps = np.random.default_rng(0).permutation(np.arange(100) * 100_000_000 + 1_700_000_000_000_000_000)
    held_out = folds(stamps, 5)
    blocks = sorted((stamps[fold].min(), stamps[fold].max(), len(fold)) for fold in held_out)
    assert [size for *_, size in blocks] == [20] * 5
    assert all(before[1] < after[0] for before, after in pairwise(blocks))


def test_twenty_poses_of_four_vertices():
    assert [len(fold) for fold in folds(np.repeat(np.arange(20), 4), 5)] == [16] * 5


@pytest.mark.parametrize(
    ("values", "count"), [([], 2), ([1, 2, 3, 4], 1), ([1, 2, 3, 4], 4), ([1, 1, 2, 2], 3), ([1.0, np.nan], 2)]
)
def test_too_little_for_folds_is_answered(values, count):
    with pytest.raises(SolveError) as caught:
        folds(values, count)
    assert caught.value.code == "bad_folds"
