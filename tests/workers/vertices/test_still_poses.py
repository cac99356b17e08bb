"""Still poses, simulated anew for each seed: region by `suggest` alone, one vertex a pose, no drive, no wall."""

from functools import cache

import numpy as np
import pytest

from apexcal.documents.detectors import DETECTORS
from apexcal.documents.errors import InputError
from tests.support.scenes.still import SETTINGS, drive, still_poses
from tests.workers.vertices.refined_walks import walk
from workers.readers.recording import Sweep
from workers.tasks.analysing import must_move
from workers.vertices import static_background
from workers.vertices.detectors import detect_range
from workers.vertices.pose_detection import fixed_place, merge_pose
from workers.vertices.region import Region
from workers.vertices.sensor_grid import SensorGrid
from workers.vertices.still_poses import find_poses
from workers.vertices.suggestion import suggest
from workers.vertices.sweep_source import Listed
from workers.vertices.vertex import PoseFacts, Rejection, Vertex

recorded = cache(still_poses)


def size(recording):
    return {"board_width_m": recording.edges_m[0], "board_height_m": recording.edges_m[1]}


def around(place, recording, margin_m=1.5):
    """A region as somebody would write it who looks at the walls too little."""
    low, high = recording.apex.min(axis=0) - margin_m, recording.apex.max(axis=0) + 0.5
    low[2], high[:2] = SETTINGS[place].ground_z + 0.1, high[:2] + margin_m - 0.5
    return Region.from_document({"all": [{"box": {"min": low.tolist(), "max": high.tolist()}}]})


def detected(recording, region, options, name="refined", **more):
    return detect_range(recording.source, region, name, options, indices=range(len(recording.sweeps)), **more)


def off_m(recording, vertices):
    return np.array([np.linalg.norm(np.array(v.xyz) - recording.apex[v.sweep_index]) for v in vertices])


@pytest.mark.parametrize(
    ("place", "seed", "count"),
    [("street", 1, 8), ("room", 2, 8), ("garage", 2, 4), pytest.param("street", 5, 8, marks=pytest.mark.slow)],
)
def test_the_suggestion_alone_finds_the_boards(place, seed, count):
    recording = recorded(place, seed, count)
    suggestion = suggest(recording.source)
    region = Region.from_document(suggestion.document)
    assert region.mask(recording.apex).all()
    assert (suggestion.facts["poses"], suggestion.facts["sweeps_moving"]) == (count, count)
    found = detected(recording, region, {})
    assert (found.poses.count, found.poses.stated) == (count, False)
    assert len(found.vertices) >= count - 1
    assert np.median(off_m(recording, found.vertices)) < 0.03
    assert off_m(recording, found.vertices).max() < 0.3


def test_walls_and_furniture_in_a_region_by_hand_cost_no_board():
    recording = recorded("room", 2, 8)
    region = around("room", recording)
    background = find_poses(recording.source, region, stated=True)
    inside = region.mask(recording.sweeps[0].xyz)
    left = background.foreground(recording.sweeps[0], inside)
    assert np.count_nonzero(inside) > 3 * np.count_nonzero(left)
    found = detected(recording, region, size(recording))
    assert len(found.vertices) == 8
    assert off_m(recording, found.vertices).max() < 0.05


@pytest.mark.parametrize(("place", "seed"), [("garage", 3), ("room", 3), ("street", 4)])
def test_one_pose_is_found_by_the_boards_shape(place, seed):
    recording = recorded(place, seed, 1)
    suggestion = suggest(recording.source)
    assert "by its shape alone" in suggestion.facts["notes"][0]
    assert suggestion.facts["poses"] == 1
    found = detected(recording, Region.from_document(suggestion.document), size(recording))
    assert off_m(recording, found.vertices).max() < 0.05


def test_sweeps_of_one_pose_give_one_vertex_wherever_shards_are_cut():
    recording = recorded("street", 1, 5, each=3)
    region = around("street", recording)
    found = detected(recording, region, size(recording))
    assert found.poses.count == 5
    assert len(found.vertices) == 5
    assert found.rejected == {"same_pose": 10}
    assert [vertex.sweep_index // 3 for vertex in found.vertices] == list(range(5))
    alone = detect_range(recording.source, region, "refined", size(recording), indices=range(4, 11))
    assert alone.vertices == [vertex for vertex in found.vertices if 4 <= vertex.sweep_index < 11]


def test_a_pose_states_no_less_than_what_its_sweeps_share():
    """Errors of three numbers: a common part, and one of each sweep's own."""
    random = np.random.default_rng(0)
    scale = np.array([0.002, 0.003, 0.01])
    stated = tuple(tuple(row) for row in np.diag(scale**2).tolist())
    scores = []
    for _ in range(400):
        common = 0.8 * random.normal(size=3)
        answers = []
        for index in range(5):
            azimuth, elevation, away = scale * (common + 0.6 * random.normal(size=3))
            reach = 10.0 + away
            flat = reach * np.cos(elevation)
            xyz = (flat * np.cos(azimuth), flat * np.sin(azimuth), reach * np.sin(elevation))
            answers.append(Vertex(xyz, index, 3, index, 10, "refined", stated, "fine"))
        (vertex,) = (answer for answer in merge_pose(answers) if isinstance(answer, Vertex))
        assert vertex.sweep_index == 2
        x, y, z = vertex.xyz
        wrong = np.array([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y)), np.linalg.norm(vertex.xyz) - 10.0])
        scores.append(wrong @ np.linalg.solve(np.array(vertex.covariance), wrong) / 3.0)
        assert np.trace(np.array(vertex.covariance) / np.outer(scale, scale)) < 3.0
    # The mean's variance is 0.64 + 0.36 / 5 of what each states; stated is a little more.
    assert 0.75 < np.mean(scores) < 1.0


def test_a_sweep_that_disagrees_is_not_averaged_in():
    answers = [Vertex((5.0, 0.0, 1.0 + 0.01 * k), k, 3, k, 10, "strict") for k in range(3)]
    other = Vertex((5.0, 1.0, 1.0), 3, 3, 3, 10, "strict")
    answers = merge_pose([*answers, other, Rejection("not_a_board")])
    assert answers[1].xyz == pytest.approx((5.0, 0.0, 1.01))
    assert [answer.reason for answer in answers[2:]] == ["same_pose", "same_pose", "not_a_board"]


def test_who_sways_out_of_the_errors_gets_a_vertex_for_each_place():
    stated = tuple(tuple(row) for row in np.diag([0.001**2, 0.001**2, 0.005**2]).tolist())
    sway = [0.0, 0.002, 0.001, 0.03, 0.032, 0.069]
    answers = merge_pose([Vertex((5.0, y, 1.0), k, 3, k, 10, "refined", stated) for k, y in enumerate(sway)])
    kept = [(k, answer.xyz[1]) for k, answer in enumerate(answers) if isinstance(answer, Vertex)]
    assert kept == [(1, pytest.approx(0.001)), (4, pytest.approx(0.031)), (5, 0.069)]


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_a_drive_is_refused(seed):
    for still in (False, True):
        with pytest.raises(InputError) as caught:
            suggest(drive(seed, 30), still=still)
        assert caught.value.code == "everything_moves"
        assert "drive" in caught.value.message
        assert "Park" in caught.value.hint


@pytest.mark.parametrize("seed", [27, pytest.param(28, marks=pytest.mark.slow)])
def test_a_walk_is_not_taken_for_poses(seed):
    sweeps = walk(seed, 30.0).sweeps
    for first in range(0, 300, 60):
        assert find_poses(Listed(sweeps[first : first + 60]), stated=False) is None
    assert find_poses(Listed(sweeps), stated=False) is None


def test_a_walk_that_is_said_to_be_poses_is_noticed():
    walked = find_poses(walk(27, 30.0).source, stated=True)
    assert walked.facts() == PoseFacts(300, True, walked=True)
    for place, count, each in (("street", 8, 1), ("street", 4, 4), ("room", 1, 3)):
        assert not find_poses(recorded(place, 3, count, each=each).source, stated=True).walked


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_size_that_is_not_the_boards_is_said(seed):
    recording = recorded("street", seed, 8)
    region = around("street", recording)
    assert not detected(recording, region, size(recording)).size.contradicts
    one, other = recording.edges_m
    for said in ((0.85 * one, 0.85 * other), (other, other)):
        seen = detected(recording, region, {"board_width_m": said[0], "board_height_m": said[1]}).size
        assert np.array(seen.seen_m) == pytest.approx(sorted(recording.edges_m), abs=3.0 * max(seen.sigma_m))
        assert max(seen.sigma_m) < 0.03  # nearly all is what blooming leaves open
        assert seen.contradicts
    assert not detected(recording, region, {}).size.contradicts


def test_a_single_pose_is_asked_for_the_boards_size():
    recording = recorded("street", 1, 8)
    region = around("street", recording)
    for index in range(0, 8, 2):
        single = Listed(recording.sweeps[index : index + 1])
        assert detect_range(single, region, "refined", {}, indices=range(1)).rejected == {"size_not_stated": 1}
        found = detect_range(single, region, "refined", size(recording), indices=range(1))
        if recording.rings[index] >= 4:
            (vertex,) = found.vertices
            assert np.linalg.norm(np.array(vertex.xyz) - recording.apex[index]) < 0.06


def test_what_stands_at_one_place_is_never_the_vertex():
    """A pillar is the highest thing in the region: `strict` would take it in every sweep."""
    recording = recorded("room", 2, 8)
    region = around("room", recording)
    pillar = np.array([[1.0, 0.0, 0.8 - 0.1 * ring] for ring in range(8)], np.float32)
    rings = np.arange(15, 7, -1).astype(np.uint16)
    sweeps = [
        Sweep(sweep.stamp_ns, np.concatenate([sweep.xyz, pillar]), np.zeros(len(sweep.xyz) + 8, np.float32),
              np.concatenate([sweep.ring, rings]), np.zeros(len(sweep.xyz) + 8, np.int64))
        for sweep in recording.sweeps
    ]  # fmt: skip
    found = detect_range(Listed(sweeps), region, "strict", indices=range(8))
    assert not [vertex for vertex in found.vertices if np.linalg.norm(np.array(vertex.xyz) - pillar[0]) < 0.1]
    only = Region.from_document({"all": [{"box": {"min": [0.9, -0.1, 0.0], "max": [1.1, 0.1, 1.0]}}]})
    nothing = detect_range(Listed(sweeps), only, "strict", indices=range(8))
    assert all({"nothing_differs", "same_pose"} <= set(words.reasons) for words in DETECTORS.values())
    assert set(nothing.rejected) <= {"nothing_differs", "no_points"}
    assert nothing.rejected["nothing_differs"] >= 6


def test_the_images_of_many_fine_rings_stay_small(monkeypatch):
    recorded = still_poses("street", 3, 4)
    fine = SensorGrid(np.linspace(-0.4, 0.2, 256), np.full(256, 2e-4), np.zeros(256), np.eye(3))
    monkeypatch.setattr(static_background, "learn_grid", lambda sweeps: fine)
    source = Listed([recorded.sweeps[0]] * 48)
    found = static_background.StaticBackground.of(source)
    assert 100e6 < found.near.nbytes + found.far.nbytes <= 128 * 1024**2
    assert found.near.shape[:2] == (48, 256)


def test_one_place_of_a_walk_is_named():
    random = np.random.default_rng(1)
    pillar = np.array([4.0, 1.0, 0.5]) + random.normal(0.0, 0.01, (32, 3))
    assert fixed_place(pillar) == pytest.approx((4.0, 1.0, 0.5), abs=0.01)
    assert fixed_place(pillar[:5]) is None
    assert fixed_place(pillar + np.linspace(0.0, 3.0, 32)[:, None]) is None


def test_still_poses_tell_no_clock_offset():
    poses = [Vertex((5.0 + 2.0 * (k % 3), 0.0, 1.0), 10**8 * k, 3, k, 10, "strict") for k in range(12)]
    walked = [Vertex((5.0, 0.1 * k, 1.0), 10**8 * k, 3, k, 10, "strict") for k in range(12)]
    must_move(walked, False)
    for vertices, said in ((poses, False), (walked, True)):
        with pytest.raises(InputError) as caught:
            must_move(vertices, said)
        assert caught.value.code == "offset_not_determined"
        assert "walk" in caught.value.hint
