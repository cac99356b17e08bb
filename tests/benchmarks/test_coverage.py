"""The short form of `make bench-coverage`: one recording, some cells; its figures fall if nothing holds."""

import numpy as np
import pytest

from benchmarks.coverage.draws import draw_score
from benchmarks.coverage.draws import summary as of_draws
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


@pytest.mark.parametrize("cell", ["shared edges", "worn tip"])
def test_the_mounts_intervals_hold_where_all_sweeps_share_the_boards_errors(cell):
    figures = of_draws(cell, [draw_score((cell, 500 + seed)) for seed in range(16)])
    # Without these errors in the budget t_x held in 0.65 and t_y in 0.28 to 0.63 of 40 draws.
    assert figures["open"] == 0 and min(figures[name] for name in ("t_x", "t_y", "t_z")) > 0.8
    assert figures["gross"] < 0.03 and figures["accused"] <= 0.1
