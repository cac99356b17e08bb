"""The short form of `make bench-coverage`: one recording, some cells; its figures fall if nothing holds."""

import numpy as np
import pytest

from benchmarks.coverage.figures import summary
from benchmarks.coverage.runs import recording


@pytest.mark.slow
def test_what_is_published_holds_in_the_short_form():
    scored = recording(100, ["clean default", "2% default", "prior_t"], 0)
    figures = summary(scored)
    assert len(scored) == 7
    # Seven calibrations of one recording: their six intervals of the mount hold together or not.
    assert np.mean([held for _, one in scored for held in one.held.values()]) > 0.8
    assert figures["sound_accused"] == 0.0
    assert figures["right_model"] >= 0.85
    assert all(one.error_deg < 0.6 and one.error_mm < 30.0 for _, one in scored)
