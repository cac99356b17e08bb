"""Still poses: real recordings through the product's own path, and simulated ones with a sensor that has flaws."""

import numpy as np
import pytest

from apexcal.documents.corners import CORNERS
from apexcal.documents.detectors import DETECTORS
from benchmarks.detection.real import DATA, RECORDINGS, judge, read, regions, run
from tests.support.scenes.held_board import BoardHold
from tests.workers.vertices.refined_walks import REGION, SIZE, errors, walk
from tests.workers.vertices.scenes import poses
from workers.vertices.board.learning import learn
from workers.vertices.detectors import detect_range
from workers.vertices.region import Region
from workers.vertices.sweep_source import Listed

DEFAULTS = {key: option.default for key, option in DETECTORS["refined"].options.items()}


def test_what_rings_disagree_by_is_learned_and_poses_are_noticed():
    model = learn(poses(16, biased_m=0.012).source, REGION, DEFAULTS | SIZE, lambda: None)
    assert model.is_posed
    assert model.bias == pytest.approx(0.012, abs=0.006)
    walked = learn(walk(27, 30.0).source, REGION, DEFAULTS | SIZE, lambda: None)
    assert not walked.is_posed
    assert walked.bias < 0.006


@pytest.mark.parametrize("upper_corner", [1, -1])
def test_an_upper_corner_of_a_board_with_level_edges_is_found_and_the_others_with_it(upper_corner):
    recorded = walk(27, 8.0, sensor="os1-64", hold=BoardHold(rolled_deg=45.0 * upper_corner + 5.0))
    options = SIZE | {"upper_corner": upper_corner}
    found = detect_range(recorded.source, REGION, "refined", options, indices=range(40))
    wrong, scaled = errors(recorded, found.vertices)
    assert len(found.vertices) > 0.85 * np.count_nonzero(recorded.rings[:40] >= 2)
    assert np.hypot(*wrong[:, :2].T).max() < 0.3
    assert np.mean(np.abs(scaled) < 2.0) > 0.9
    for vertex in found.vertices:
        for name, xyz in zip(vertex.corners.names, vertex.corners.xyz, strict=True):
            true = recorded.corners[vertex.sweep_index][CORNERS.index(name)]
            assert np.linalg.norm(true - xyz) < 0.15
    # Nothing shows that it is carried in half a second: it could be a sign.
    short = Listed(recorded.sweeps[:5])
    found = detect_range(short, REGION, "refined", options, indices=range(5))
    assert not found.vertices
    assert "upright_object" in found.rejected


OS1, VLP16 = ("os1-64-board", 11, 0.015), ("vlp16-diamond-board", 20, 0.02)


@pytest.mark.parametrize(("name", "fewest", "most_m"), [OS1, VLP16])
def test_real_poses_by_one_who_knows_nothing(name, fewest, most_m):
    check_real(name, fewest, {("suggested", False): most_m})


@pytest.mark.parametrize(("name", "fewest"), [OS1[:2], VLP16[:2]])
def test_real_poses_by_one_who_knows_everything(name, fewest):
    check_real(name, fewest, {("by hand", True): 0.015})


@pytest.mark.slow
@pytest.mark.parametrize(("name", "fewest", "size_open_m"), [OS1, VLP16])
def test_real_poses_with_part_of_what_a_person_knows(name, fewest, size_open_m):
    check_real(name, fewest, {("by hand", False): size_open_m, ("suggested", True): 0.015})


def check_real(name, fewest, middle_m):
    """``middle_m``: by region and whether the size is known."""
    if not (DATA / name).exists():
        pytest.skip("the real recording is absent: it is looked for in ../shared/data")
    source, top = read(name), judge(name)
    known = {"board_width_m": RECORDINGS[name].width_m, "board_height_m": RECORDINGS[name].height_m}
    by_hand = {"by hand": Region.from_document(RECORDINGS[name].region)}
    found = regions(name, source) if any(region == "suggested" for region, _ in middle_m) else by_hand
    for (region, is_known), most_m in middle_m.items():
        off = np.array([*run(source, found[region], known if is_known else {}, top).off_m.values()])
        assert len(off) >= fewest
        assert np.median(off) < most_m
        assert np.count_nonzero(off > 0.04) <= (name == "vlp16-diamond-board")  # one published row is an outlier
