"""The exponent that `make bench-growth` prints."""

import pytest

from benchmarks.growth.__main__ import LONG, SHORT, exponent


def test_an_exponent_is_that_of_the_two_largest_sizes() -> None:
    assert exponent({1_000: 20.0, 10: 9.0, 100: 2.0}) == pytest.approx(1.0)
    assert exponent({10: 1.0, 100: 1.0, 1_000: 100.0}) == pytest.approx(2.0)
    for sizes in (LONG, SHORT):
        assert all(largest == 10 * middle for _, middle, largest in sizes)
