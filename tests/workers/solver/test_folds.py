import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from apexcal.documents.folds import cut_folds
from tests.workers.solver.rigs import real_correspondences
from workers.solver.held_out import folds
from workers.solver.outcomes import SolveError


@given(st.lists(st.integers(0, 8), min_size=30, max_size=80), st.integers(2, 3))
def test_groups_stay_whole_and_every_pair_is_held_out_once(groups, count):
    if len(set(groups)) < count:
        groups = [*groups, 20, 21, 22]
    held_out = [fold.indices for fold in folds(groups, count)]
    assert len(held_out) == count
    np.testing.assert_array_equal(np.sort(np.concatenate(held_out)), np.arange(len(groups)))
    members = [set(np.array(groups)[fold]) for fold in held_out]
    assert all(len(fold) > 0 for fold in held_out)
    for i, one in enumerate(members):
        assert all(one.isdisjoint(other) for other in members[i + 1 :])


@given(st.lists(st.integers(1, 12), min_size=10, max_size=60), st.integers(2, 5))
def test_folds_differ_by_no_more_than_a_block(sizes, count):
    cut = cut_folds([pose for pose, size in enumerate(sizes) for _ in range(size)], count)
    of_fold, of_block = np.bincount(cut.fold), np.bincount(cut.block)
    assert of_fold.max() - of_fold.min() <= of_block.max()
    assert cut.largest() == of_fold.max()


def test_stamps_make_blocks_of_time_that_lie_between_fitted_ones():
    stamps = np.random.default_rng(0).permutation(np.arange(100) * 100_000_000 + 1_700_000_000_000_000_000)
    held_out = folds(stamps, 5)
    assert [len(fold.indices) for fold in held_out] == [20] * 5
    for fold in held_out:
        times = np.sort(stamps[fold.indices]) // 100_000_000
        runs = np.split(times, np.flatnonzero(np.diff(times) > 1) + 1)
        assert [len(run) for run in runs] == [5] * 4
        assert len(set(fold.blocks.tolist())) == 4


def test_the_folds_of_a_walk_in_lanes_are_not_the_lanes():
    # Four rounds of five lanes: a fold has another lane in each round.
    for fold in folds(np.repeat(np.arange(20), 2), 5):
        assert len(set((fold.blocks % 5).tolist())) == 4


def test_twenty_poses_of_four_vertices():
    poses = np.repeat(np.arange(20), 4)
    held_out = folds(poses, 5)
    assert [len(fold.indices) for fold in held_out] == [16] * 5
    assert all(np.diff(np.unique(poses[fold.indices])).min() > 1 for fold in held_out)


def test_the_real_poses_are_cut_alike_in_whatever_order_they_come():
    _, _, poses = real_correspondences()
    order = np.random.default_rng(3).permutation(len(poses))
    one = [set(poses[fold.indices].tolist()) for fold in folds(poses, 5)]
    assert one == [set(poses[order][fold.indices].tolist()) for fold in folds(poses[order], 5)]


@pytest.mark.parametrize(
    ("values", "count"), [([], 2), ([1, 2, 3, 4], 1), ([1, 2, 3, 4], 4), ([1, 1, 2, 2], 3), ([1.0, np.nan], 2)]
)
def test_too_little_for_folds_is_answered(values, count):
    with pytest.raises(SolveError) as caught:
        folds(values, count)
    assert caught.value.code == "bad_folds"
