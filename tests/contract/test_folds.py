"""The service counts the folds that the workers cut."""

from hypothesis import given, settings
from hypothesis import strategies as st

from service.calibrations.fold_rules import fold_count
from workers.solver.held_out import folds

column = st.one_of(
    st.lists(st.integers(0, 6), min_size=1, max_size=60).map(lambda groups: {"group": groups}),
    st.lists(st.integers(0, 10**18), min_size=1, max_size=60).map(lambda stamps: {"stamp_ns": stamps}),
    st.lists(st.sampled_from(["a", "b", "c", "dd"]), min_size=1, max_size=60).map(lambda groups: {"group": groups}),
    st.integers(1, 60).map(lambda _: {}),
)


@settings(max_examples=300, deadline=None)
@given(column, st.integers(1, 60), st.integers(2, 8), st.integers(1, 16))
def test_the_workers_can_cut_the_folds_that_the_service_counts(given_column, size, wanted, free):
    count = len(next(iter(given_column.values()))) if given_column else size
    pairs = {"x": [0.0] * count, **given_column}
    counts, sentences = fold_count(pairs, wanted, {"pinhole": free}, "front")
    number = counts["pinhole"]
    assert (not sentences) == (number == wanted)
    if not number:
        return
    values = pairs.get("group") or pairs.get("stamp_ns") or range(count)
    blocks = folds(values, number)
    assert len(blocks) == number
    assert all(count - len(block.indices) >= free for block in blocks)
