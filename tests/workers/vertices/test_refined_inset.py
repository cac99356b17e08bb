"""How far inside of an edge beams still meet the body."""

from __future__ import annotations

import pytest

from apexcal.documents.detectors import resolve_options
from benchmarks.detection.walks import looked_at
from tests.support.scenes.drawn import draw
from workers.vertices.board.learning import learn
from workers.vertices.detectors import without_fixed
from workers.vertices.region import Region
from workers.vertices.sweep_source import Listed


@pytest.fixture(scope="module")
def drawn():
    """A surface must fill two fifths of this beam to answer, and somebody's body is 0.25 m behind the board."""
    return draw(9016)


@pytest.fixture(scope="module")
def learned(drawn):
    source = Listed(looked_at(*drawn.simulated(2.5), 2.5).sweeps)
    options = resolve_options("refined", {"board_width_m": drawn.board_m[0], "board_height_m": drawn.board_m[1]})
    return learn(source, without_fixed(source, Region.from_document(drawn.region())), options, lambda: None)


def test_the_inset_is_the_beam_and_the_growth_is_much_less(drawn, learned):
    half_rad = 0.5e-3 * drawn.disturbances.beam_mrad
    assert learned.inset == pytest.approx(half_rad, rel=0.35)
    assert learned.blooming < 0.25 * half_rad
