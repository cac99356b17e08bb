import numpy as np
import pytest

from apexcal.documents.detectors import DETECTORS, resolve_options
from apexcal.documents.errors import DocumentError
from tests.workers.vertices.sweeps import EVERYTHING, IN_FRONT, row, sweep
from workers.vertices.detectors import detect_range
from workers.vertices.sweep_source import Listed
from workers.vertices.vertex import Rejection, Vertex


def detect(name, seen, region, options=None):
    """The vertex of a single sweep, or the reason why there is none."""
    found = detect_range(Listed([seen]), region, name, options, indices=range(1))
    if found.vertices:
        return found.vertices[0]
    (reason,) = found.rejected
    return Rejection(reason)


STRICT_FRAME = row(2, 5) + row(3, 4) + row(5, 1)
TOLERANT_FRAME = row(3, 5) + row(4, 4) + row(5, 3) + row(6, 2)


def test_strict_takes_the_single_point_of_the_top_ring():
    found = detect("strict", sweep(STRICT_FRAME, stamp_ns=7_000), EVERYTHING)
    assert isinstance(found, Vertex)
    assert found.xyz == pytest.approx((5.0, 0.0, 0.5))
    assert (found.ring, found.sweep_index, found.points_used, found.detector) == (5, 0, 1, "strict")
    assert found.time_ns == 7_000 + 9_000  # the tenth point's own moment, not the sweep's stamp


def test_points_that_are_not_finite_do_not_count():
    hidden = [(9, np.nan, 0.0, 0.0), (9, 5.0, np.inf, 0.0)]
    found = detect("strict", sweep(STRICT_FRAME + hidden), EVERYTHING)
    assert isinstance(found, Vertex)
    assert found.ring == 5


def test_tolerant_averages_the_top_ring():
    points = sweep(TOLERANT_FRAME, stamp_ns=1_000_000)
    found = detect("tolerant", points, EVERYTHING)
    assert isinstance(found, Vertex)
    assert found.xyz == pytest.approx((5.0, 0.01, 0.6))
    assert found.points_used == 2
    assert found.time_ns == 1_000_000 + 12_500  # between the 13th and the 14th point


WIDE = row(4, 5) + row(5, 3) + row(6, 4)


@pytest.mark.parametrize(
    ("name", "points", "options", "reason"),
    [
        ("strict", [], None, "no_points"),
        ("strict", row(9, 8, x=-5.0), None, "no_points"),
        ("strict", row(3, 5) + row(4, 4) + row(5, 1), None, "ring_span_too_small"),
        ("strict", row(5, 1), None, "ring_span_too_small"),
        ("strict", row(2, 5) + row(5, 2), None, "top_ring_not_single"),
        ("strict", row(0, 1) + row(3, 1), None, None),  # no ring in between is needed
        ("strict", row(1, 1) + row(2, 1), {"min_ring_span": 1}, None),
        ("tolerant", [], None, "no_points"),
        ("tolerant", row(4, 5) + row(5, 3) + row(6, 1), None, "too_few_points"),
        ("tolerant", row(4, 3) + row(5, 4) + row(6, 3, step=0.0249), None, None),  # exactly ten, nearly 5 cm
        ("tolerant", WIDE, None, "top_ring_too_wide"),
        ("tolerant", WIDE, {"max_top_points": 4, "max_spread_m": 0.1}, None),
        ("tolerant", row(4, 5) + row(5, 3) + row(6, 2, step=0.06), None, "top_points_apart"),
        ("tolerant", row(4, 5) + row(5, 3) + row(6, 3, step=0.03), None, "top_points_apart"),
        ("tolerant", row(3, 5) + row(4, 2) + row(5, 3) + row(6, 2), None, "too_few_points_two_rings_below"),
        ("tolerant", row(5, 9) + row(6, 2), None, "too_few_points_two_rings_below"),
        ("tolerant", row(0, 3), {"min_points": 1}, "too_few_points_two_rings_below"),
    ],
)
def test_each_rule_says_why_it_rejects(name, points, options, reason):
    found = detect(name, sweep(points), IN_FRONT, options)
    assert isinstance(found, Vertex) if reason is None else found == Rejection(reason)


def test_all_reasons_are_announced_and_counted():
    sweeps = [sweep(STRICT_FRAME), sweep([]), sweep(row(2, 5) + row(5, 2)), sweep(STRICT_FRAME), sweep([])]
    found = detect_range(Listed(sweeps), EVERYTHING, "strict", indices=range(5))
    assert [vertex.sweep_index for vertex in found.vertices] == [0, 3]
    assert found.frames == 5
    assert found.refused == {1: "no_points", 2: "top_ring_not_single", 4: "no_points"}
    assert found.rejected == {"no_points": 2, "top_ring_not_single": 1}
    assert set(found.rejected) <= set(DETECTORS["strict"].reasons)
    nothing = detect_range(Listed([]), EVERYTHING, "tolerant", indices=range(0))
    assert (nothing.vertices, nothing.frames, nothing.rejected) == ([], 0, {})


def test_a_range_gives_its_own_vertices_and_those_around_it_as_context():
    sweeps = Listed([sweep(STRICT_FRAME)] * 3 + [sweep([])] + [sweep(STRICT_FRAME)] * 3)
    done = []
    found = detect_range(sweeps, EVERYTHING, "strict", indices=range(2, 5), margin=2, on_sweep=done.append)
    assert [vertex.sweep_index for vertex in found.vertices] == [2, 4]
    assert [vertex.sweep_index for vertex in found.context] == [0, 1, 5, 6]
    assert (found.frames, found.rejected) == (3, {"no_points": 1})
    assert done == sorted(done)
    assert set(done) == {2, 3, 4}
    whole = detect_range(sweeps, EVERYTHING, "strict", indices=range(7), margin=2)
    assert whole.vertices == [*found.context[:2], *found.vertices, *found.context[2:]]
    assert whole.context == ()


@pytest.mark.parametrize("indices", [range(0, 4, 2), range(-1, 2), range(2, 4)])
def test_a_range_that_the_source_does_not_have_is_refused(indices):
    with pytest.raises(ValueError, match="within 0 to 2"):
        detect_range(Listed([sweep(STRICT_FRAME)] * 3), EVERYTHING, "strict", indices=indices)


@pytest.mark.parametrize(
    ("name", "options", "code"),
    [
        ("strict", {"min_points": 3}, "invalid_options"),
        ("tolerant", {"max_spread_m": float("nan")}, "invalid_options"),
        ("tolerant", {"max_spread_m": "wide"}, "invalid_options"),
        ("tolerant", {"min_points": 2.5}, "invalid_options"),
        ("refined", {"upper_corner": 1, "board_width_m": 0.6}, "invalid_options"),
    ],
)
def test_bad_options_are_refused(name, options, code):
    with pytest.raises(DocumentError) as caught:
        resolve_options(name, options)
    assert caught.value.code == code
