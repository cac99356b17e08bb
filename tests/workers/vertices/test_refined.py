"""The refined detector on simulated walks, and on the 20 real poses."""

from itertools import pairwise

import numpy as np
import pytest

from apexcal.documents.detectors import DETECTORS, FLAGS
from apexcal.documents.simulation import Disturbances
from tests.workers.vertices.refined_walks import REGION, SIZE, errors, walk
from tests.workers.vertices.sweeps import EVERYTHING, row, sweep
from workers.vertices.board.learning import learn
from workers.vertices.board.model import hang
from workers.vertices.detectors import detect_range
from workers.vertices.sweep_source import Listed

KNOWN = DETECTORS["refined"].options
DEFAULTS = {key: option.default for key, option in KNOWN.items()}


def detected(recorded, options=SIZE, indices=None, **more):
    return detect_range(recorded.source, REGION, "refined", options, indices=indices or recorded.all, **more)


@pytest.fixture(scope="module")
def whole():
    """A walk of 30 s and what is found in it, at once."""
    recorded = walk(27, 30.0)
    return recorded, detected(recorded)


def test_most_boards_give_a_vertex_whose_stated_error_holds(whole):
    recorded, found = whole
    wrong, scaled = errors(recorded, found.vertices)
    visible = np.count_nonzero(recorded.rings >= 2)
    assert len(found.vertices) > 0.65 * visible
    assert np.sqrt(np.mean(wrong[:, 1] ** 2)) < 0.05
    assert np.sqrt(np.mean(np.sum(wrong[:, :2] ** 2, axis=1))) < 0.09
    assert abs(wrong[:, 1].mean()) < 0.02
    assert np.mean(np.hypot(*wrong[:, :2].T) > 0.3) < 0.02
    assert np.mean(np.abs(scaled) < 2) > 0.9
    fine = [k for k, vertex in enumerate(found.vertices) if vertex.quality == "fine"]
    assert len(fine) > 0.25 * visible
    assert np.sqrt(np.mean(wrong[fine, 1] ** 2)) < 0.04
    assert found.frames == len(recorded.all) == len(found.vertices) + sum(found.rejected.values())
    numbers = sorted([*(vertex.sweep_index for vertex in found.vertices), *found.refused])
    assert numbers == list(range(found.frames))
    assert set(found.rejected) <= set(DETECTORS["refined"].reasons)


def test_a_vertex_says_when_and_from_what_it_was_measured(whole):
    recorded, found = whole
    for vertex in found.vertices:
        assert abs(vertex.time_ns - recorded.moment_ns[vertex.sweep_index]) < 300_000
        assert vertex.points_used >= 3
        assert vertex.detector == "refined"
        assert set(vertex.flags) <= set(FLAGS)
        covariance = np.array(vertex.covariance)
        np.testing.assert_allclose(covariance, covariance.T, atol=1e-15)
        assert np.linalg.eigvalsh(covariance).min() > 0


def test_shards_give_what_the_whole_gives(whole):
    recorded, found = whole
    ends = (0, 75, 150, 300)
    parts = [detected(recorded, indices=range(*part), margin=3) for part in pairwise(ends)]
    assert [vertex for part in parts for vertex in part.vertices] == found.vertices
    reasons = [part.rejected for part in parts]
    assert {name: sum(part.get(name, 0) for part in reasons) for name in found.rejected} == found.rejected
    beside = [vertex for vertex in found.vertices if vertex.sweep_index in (72, 73, 74, 150, 151, 152)]
    assert list(parts[1].context) == beside


def test_board_beam_and_person_are_learned_from_near_sweeps():
    recorded = walk(12, 40.0, disturbances=Disturbances(beam_mrad=3.0))
    model = learn(recorded.source, REGION, DEFAULTS | SIZE, lambda: None)
    assert model.growth == pytest.approx(1.5e-3, abs=0.5e-3)
    assert model.sigma == pytest.approx(0.0085, abs=0.003)
    assert np.degrees(hang(model.edges) + model.roll[0]) == pytest.approx(45, abs=4)
    assert abs(model.tilt[0]) < 0.08
    assert model.swapped < 0.3
    unknown = learn(recorded.source, REGION, DEFAULTS | {"edge_growth_mrad": 1.5}, lambda: None)
    assert sorted(unknown.edges) == pytest.approx(sorted(SIZE.values()), abs=0.02)


def test_a_head_above_the_board_is_no_apex_and_is_flagged():
    recorded = walk(13, 15.0, disturbances=Disturbances(head_above_m=0.12))
    found = detected(recorded)
    wrong, _ = errors(recorded, found.vertices)
    assert len(found.vertices) > 30
    assert np.mean(np.hypot(*wrong[:, :2].T) > 0.3) <= 0.03
    assert np.mean(["head_above" in vertex.flags for vertex in found.vertices]) > 0.3


def test_poles_and_a_second_person_are_no_boards():
    spoiled = Disturbances(poles=5, second_person="beside")
    recorded = walk(14, 15.0, disturbances=spoiled)
    found = detected(recorded)
    wrong, _ = errors(recorded, found.vertices)
    assert len(found.vertices) > 0.4 * np.count_nonzero(recorded.rings >= 2)
    assert np.mean(np.hypot(*wrong[:, :2].T) > 0.3) <= 0.03


def test_the_track_steadies_the_roll():
    recorded = walk(27, 30.0)
    off = []
    for track in (0, 1):
        found = detected(recorded, SIZE | {"track": track, "max_sigma_deg": 0.3}, indices=range(150))
        wrong, _ = errors(recorded, found.vertices)
        off.append({vertex.sweep_index: wrong[k, 0] for k, vertex in enumerate(found.vertices)})
    both = sorted(off[0].keys() & off[1].keys())
    alone, helped = (np.sqrt(np.mean([of_track[i] ** 2 for i in both])) for of_track in off)
    assert helped < 0.95 * alone


@pytest.mark.parametrize(
    ("points", "reason"),
    [([], "no_points"), (row(3, 5), "too_few_rings"), (row(3, 1) + row(9, 1, z=3.0), "too_few_rings")],
)
def test_nothing_like_a_board_is_rejected_with_a_reason(points, reason):
    found = detect_range(Listed([sweep(points)] * 2), EVERYTHING, "refined", SIZE, indices=range(2))
    assert found.rejected == {reason: 2}
    unknown = detect_range(Listed([sweep(points)] * 2), EVERYTHING, "refined", indices=range(2))
    assert unknown.rejected == {"size_not_stated" if points else "no_points": 2}


def test_a_wall_is_no_board():
    """Wide stretches on many rings in one plane."""
    wall = [(ring, 8.0, 0.028 * column, 0.28 * ring) for ring in range(8) for column in range(-120, 120)]
    found = detect_range(Listed([sweep(wall)] * 6), EVERYTHING, "refined", indices=range(6))
    assert found.vertices == []
