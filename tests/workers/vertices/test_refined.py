"""The refined detector on simulated walks: tips, all corners, and what happens to these between sweeps."""

from dataclasses import replace

import numpy as np
import pytest

from apexcal.documents.corners import CORNERS
from apexcal.documents.detectors import DETECTORS, FLAGS
from apexcal.documents.simulation import Disturbances
from benchmarks.detection.real import DATA, DIAMOND, RECORDINGS, corners_compared, judge, read, run
from tests.workers.vertices.refined_walks import REGION, SIZE, angles, corners_at, errors, walk, walker
from tests.workers.vertices.sweeps import EVERYTHING, row, sweep
from workers.vertices.board.learning import learn
from workers.vertices.board.model import rest_angle
from workers.vertices.corners import move_corners
from workers.vertices.detectors import detect_range
from workers.vertices.pairing import pair_interpolated
from workers.vertices.pose_detection import merge_pose
from workers.vertices.region import Region
from workers.vertices.sweep_source import Listed
from workers.vertices.vertex import Corners

KNOWN = DETECTORS["refined"].options
DEFAULTS = {key: option.default for key, option in KNOWN.items()}


def detected(recorded, options=SIZE, indices=None, **more):
    return detect_range(recorded.source, REGION, "refined", options, indices=indices or recorded.all, **more)


@pytest.fixture(scope="module")
def whole():
    """A walk of 18 s and what is found in it, at once."""
    recorded = walk(27, 18.0)
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


def test_a_shard_gives_what_the_whole_gives(whole):
    recorded, found = whole
    own = range(60, 120)
    part = detected(recorded, indices=own, margin=3)
    assert part.vertices == [vertex for vertex in found.vertices if vertex.sweep_index in own]
    assert part.refused == {index: reason for index, reason in found.refused.items() if index in own}
    beside = [vertex for vertex in found.vertices if vertex.sweep_index in (57, 58, 59, 120, 121, 122)]
    assert list(part.context) == beside


def test_board_beam_and_person_are_learned_from_near_sweeps():
    recorded = walk(12, 24.0, disturbances=Disturbances(beam_mrad=3.0))
    model = learn(recorded.source, REGION, DEFAULTS | SIZE, lambda: None)
    assert model.blooming == pytest.approx(1.5e-3, abs=0.5e-3)
    assert model.sigma == pytest.approx(0.0085, abs=0.003)
    assert np.degrees(rest_angle(model.edges) + model.roll[0]) == pytest.approx(45, abs=4)
    assert abs(model.tilt[0]) < 0.08
    assert model.swapped < 0.3
    unknown = learn(recorded.source, REGION, DEFAULTS | {"edge_growth_mrad": 1.5}, lambda: None)
    assert sorted(unknown.edges) == pytest.approx(sorted(SIZE.values()), abs=0.02)


def test_the_track_steadies_the_roll(whole):
    recorded, _ = whole
    off = []
    for track in (0, 1):
        found = detected(recorded, SIZE | {"track": track, "max_sigma_deg": 0.3}, indices=range(60))
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


def off(vertex, truth):
    """(3 (1 + corners),) azimuth, elevation and range of apex and corners, minus the true ones."""
    places = [CORNERS.index(name) for name in ("top", *vertex.corners.names)]
    return (angles([vertex.xyz, *vertex.corners.xyz]) - angles(truth[places])).ravel()


def test_each_corner_lies_where_it_is_said_to_lie(whole):
    """Chi-square of each corner alone; below 1, because a simulated board has none of a real one's flaws."""
    recorded, vertices = whole[0], whole[1].vertices
    scores = {name: [] for name in CORNERS}
    for vertex in vertices:
        wrong, covariance = off(vertex, recorded.corners[vertex.sweep_index]), np.array(vertex.corners.covariance)
        for place, name in enumerate(("top", *vertex.corners.names)):
            rows = slice(3 * place, 3 * place + 3)
            scores[name].append(wrong[rows] @ np.linalg.solve(covariance[rows, rows], wrong[rows]) / 3.0)
    for name in CORNERS:
        assert len(scores[name]) > 0.95 * len(vertices)
        assert 0.3 < np.mean(scores[name]) < 1.2, name
        assert np.mean(np.array(scores[name]) > 2.6) < 0.05, name  # one of twenty: chi-square of 3 at 0.95 over 3


def test_the_corners_of_a_sweep_err_together_as_they_say(whole):
    """Chi-square over the joint covariance."""
    recorded, vertices = whole[0], whole[1].vertices
    scores, known = [], []
    for vertex in vertices:
        covariance = np.array(vertex.corners.covariance)
        np.testing.assert_allclose(covariance, covariance.T, rtol=1e-9, atol=1e-18)
        stated = np.array(vertex.covariance)
        unit = np.sqrt(np.outer(np.diag(stated), np.diag(stated)))
        np.testing.assert_allclose(covariance[:3, :3] / unit, stated / unit, atol=0.02)
        scale = np.sqrt(np.diag(covariance))
        size, axis = np.linalg.eigh(covariance / np.outer(scale, scale))
        assert size.min() > -1e-9
        told = size > 1e-6
        score = (axis.T @ (off(vertex, recorded.corners[vertex.sweep_index]) / scale))[told] ** 2 / size[told]
        scores.append(score.mean())
        if len(vertex.corners.names) == 3:
            ranges = covariance[2::3, 2::3]
            known.append(ranges[0, 3] / np.sqrt(ranges[0, 0] * ranges[3, 3]))
    assert 0.3 < np.mean(scores) < 1.2
    # What the rings may have in common is learned as 2 mm here, and is the same for both.
    assert np.median(known) < -0.2, "a plane that leans farther has its top farther away and its bottom nearer"


def test_without_the_boards_size_there_is_only_the_apex(whole):
    recorded, _ = whole
    for options in ({}, {"board_width_m": SIZE["board_width_m"]}):
        found = detect_range(recorded.source, REGION, "refined", options, indices=range(20))
        assert found.vertices
        assert all(vertex.corners is None for vertex in found.vertices)


def test_a_corner_moves_along_the_track_with_its_apex(whole):
    """A camera that takes its frames up to half a sweep beside the vertices."""
    recorded, vertices = whole[0], whole[1].vertices
    way = walker(27, 18.0)
    start = recorded.source.sweep(0).stamp_ns
    stamps = start + np.arange(0, 18_000_000_000, 70_000_000)
    track = pair_interpolated(vertices, stamps, max_gap_ns=50_000_000)
    assert np.mean(np.abs(track.moved_ns)) > 10_000_000
    scores, stayed = [], []
    for vertex, frame, xyz, covariance in zip(vertices, track.index, track.xyz, track.covariance, strict=True):
        if frame < 0:
            continue
        truth = corners_at(way, (stamps[frame] - start) * 1e-9)
        for corner in move_corners(vertex, xyz, covariance):
            assert np.linalg.eigvalsh(corner.covariance).min() > 0.0
            wrong = (angles(corner.xyz) - angles(truth[CORNERS.index(corner.name)]))[0]
            scores.append(wrong @ np.linalg.solve(corner.covariance, wrong) / 3.0)
            own, true = vertex.corners.xyz[vertex.corners.names.index(corner.name)], truth[CORNERS.index(corner.name)]
            stayed.append(np.linalg.norm(own - true) / np.linalg.norm(corner.xyz - true))
    assert len(scores) > 200
    assert 0.3 < np.mean(scores) < 1.2
    assert np.median(stayed) > 1.3, "a corner that stayed would lie farther off"


def test_the_mean_of_a_poses_sweeps_has_the_mean_corners(whole):
    vertices = whole[1].vertices
    vertex = next(one for one in vertices if len(one.corners.names) == 3)
    random = np.random.default_rng(5)
    noisy = [
        replace(
            vertex,
            xyz=tuple(vertex.xyz + shift[0]),
            corners=Corners.of(vertex.corners.names, vertex.corners.xyz + shift[1:], vertex.corners.covariance),
        )
        for shift in random.normal(0.0, 0.002, (4, 4, 3))
    ]

    def mean_of(vertices):
        (mean,) = [one for one in merge_pose(vertices) if not hasattr(one, "reason")]
        return mean

    mean = mean_of(noisy)
    np.testing.assert_allclose(mean.corners.xyz, np.mean([one.corners.xyz for one in noisy], axis=0))
    covariance = np.array(mean.corners.covariance)
    np.testing.assert_allclose(covariance[:3, :3], mean.covariance, rtol=1e-6)
    before = np.array(vertex.corners.covariance)
    assert (np.diag(covariance) < np.diag(before) * 1.02).all()
    assert np.linalg.eigvalsh(covariance / np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))).min() > -1e-9
    some = [replace(noisy[0], corners=Corners.of(("left",), [noisy[0].corners.xyz[0]], before[:6, :6])), *noisy[1:]]
    assert mean_of(some).corners.names == ("left",)
    assert mean_of([replace(noisy[0], corners=None), *noisy[1:]]).corners is None


def test_a_real_board_has_its_corners():
    """20 poses, of which one is published wrongly. The judges' own errors (4 to 10 mm) are not allowed for."""
    if not (DATA / DIAMOND).exists():
        pytest.skip("the real recording is absent: it is looked for in ../shared/data")
    poses = RECORDINGS[DIAMOND]
    size = {"board_width_m": poses.width_m, "board_height_m": poses.height_m}
    vertices = run(read(DIAMOND), Region.from_document(poses.region), size, judge(DIAMOND)).vertices
    for name, rows in corners_compared(vertices.values()).items():
        assert len(rows) >= 18  # one is known to `max_sigma_deg` hardly
        assert np.median(rows[:, 0]) < 0.02, name
        assert np.median(rows[:, 1]) < 3.0, name
