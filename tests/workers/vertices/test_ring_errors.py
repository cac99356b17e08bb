"""What rings have in common, told apart from the noise of each distance."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.detection.walks import found, looked_at
from tests.support.scenes.drawn import draw
from workers.vertices.board.plane_learning import analyse_variance
from workers.vertices.detectors import detect_range
from workers.vertices.region import Region
from workers.vertices.sweep_source import Listed


@pytest.mark.parametrize("rings", [3, 18])
@pytest.mark.parametrize("ring_m", [0.0, 0.012])
def test_the_errors_of_rings_are_told_apart_from_noise(rings, ring_m):
    random = np.random.default_rng([rings, round(1e3 * ring_m)])
    ring = np.repeat(np.arange(rings), 14)
    plane = np.column_stack([np.ones(ring.size), ring, np.tile(np.linspace(-1.0, 1.0, 14), rings)])
    fitted = plane @ np.linalg.pinv(plane)
    told = []
    for _ in range(2000):
        error = random.normal(0.0, 0.008, ring.size) + random.normal(0.0, ring_m, rings)[ring]
        told.append(analyse_variance(error - fitted @ error, ring))
    within, between = (np.median([getattr(one, name) for one in told]) for name in ("within", "between"))
    assert np.sqrt(within) == pytest.approx(0.008, rel=0.05)
    assert np.sqrt(max(between, 0.0)) == pytest.approx(ring_m, abs=0.0015)


def test_two_rings_tell_nothing_of_their_errors():
    assert analyse_variance(np.linspace(-0.01, 0.01, 20), np.repeat([0, 1], 10)) is None
    assert analyse_variance(np.linspace(-0.01, 0.01, 11), np.repeat([0, 1, 2], [5, 5, 1])) is None


def test_the_range_errs_as_it_is_stated_where_rings_err():
    """Three rings with errors of 11 mm: their plane leans by as much as they make it."""
    drawn = draw(10107)
    assert drawn.flaws.ring_bias_m > 0.01
    walked = looked_at(*drawn.simulated(12.0), 12.0)
    seen = found(walked, Region.from_document(drawn.region()), "refined", _size(drawn))
    assert len(seen.vertices) > 45
    assert np.mean(np.abs(seen.vertices[:, 2] / seen.vertices[:, 5]) < 2.0) > 0.8


def test_far_boards_that_tell_little_do_not_make_a_right_size_wrong():
    """16 boards at 16 m and more, with shots 0.12 m apart. An edge length 14 % less explains them no better."""
    drawn = draw(10014)
    _, lidar = drawn.simulated(30.0)
    rate = lidar.sensor.rate_hz
    source = Listed([lidar.sweep(k, k / rate, round(k / rate * 1e9)) for k in range(0, round(30.0 * rate), 6)])
    region = Region.from_document(drawn.region())
    size = detect_range(source, region, "refined", _size(drawn), indices=range(1)).size
    assert size is not None and not size.contradicts


def _size(drawn):
    return {"board_width_m": drawn.board_m[0], "board_height_m": drawn.board_m[1]}
