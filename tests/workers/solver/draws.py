"""How many draws a statistic is made of: few that tell a wrong one, and more in the long form."""

from __future__ import annotations

import pytest


def few_or_many(few: int, many: int) -> pytest.MarkDecorator:
    """Runs a test with so many ``draws``; the second number is for `make test-long`."""
    return pytest.mark.parametrize("draws", [few, pytest.param(many, marks=pytest.mark.slow)])
