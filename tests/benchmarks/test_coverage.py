"""Two cells of `make bench-coverage`: its figures fall if nothing holds."""

import pytest

from benchmarks.coverage.draws import draw_score, summary


@pytest.mark.parametrize("cell", ["shared edges", "worn tip"])
def test_the_mounts_intervals_hold_where_all_sweeps_share_the_boards_errors(cell):
    figures = summary(cell, [draw_score((cell, 500 + seed)) for seed in range(16)])
    # Without these errors in the budget t_x held in 0.65 and t_y in 0.28 to 0.63 of 40 draws.
    assert figures["open"] == 0 and min(figures[name] for name in ("t_x", "t_y", "t_z")) > 0.8
    assert figures["gross"] < 0.03 and figures["accused"] <= 0.1
