"""What is promised of the refined detector: each scene of the table of scenes keeps what its row says."""

import numpy as np
import pytest

from tests.workers.vertices.refined_walks import angles
from tests.workers.vertices.scenes import Scene, each_scene
from workers.vertices.detectors import detect_range
from workers.vertices.sweep_source import Listed


@each_scene
def test_a_scene_keeps_its_promises(scene: Scene):
    seen = scene.make()
    looked = range(seen.first or len(seen.sweeps))
    found = detect_range(Listed(seen.sweeps), seen.region, "refined", seen.options, indices=looked)
    if scene.refused:
        reason, count = scene.refused
        assert not found.vertices and found.rejected.get(reason, 0) >= count, found.rejected
        assert reason != "not_a_board" or found.size is None
        return
    vertices = [one for one in found.vertices if seen.may_be is None or seen.may_be[one.sweep_index]]
    assert len(found.vertices) - len(vertices) <= scene.elsewhere
    assert len(vertices) >= scene.fewest
    assert len(vertices) > scene.least * np.count_nonzero(seen.is_there[: looked.stop])
    xyz, apex = np.array([one.xyz for one in vertices]), seen.apex[[one.sweep_index for one in vertices]]
    assert np.linalg.norm(xyz - apex, axis=1).max() < scene.worst_m
    wrong = angles(xyz) - angles(apex)
    scaled = wrong / np.sqrt([np.diag(vertex.covariance) for vertex in vertices])
    wrong = np.degrees(wrong[:, :2])
    assert np.hypot(*wrong.T).max() < scene.worst_deg
    assert np.abs(wrong.mean(axis=0)).max() < scene.mean_deg
    assert np.mean(np.hypot(*wrong.T) > 0.3) <= scene.gross
    assert np.mean(np.abs(scaled) < 2.0) >= scene.within
    flag, share = scene.flagged
    assert np.mean([flag in vertex.flags for vertex in vertices]) >= share
    if scene.roll_deg is not None:
        rolls = np.degrees([vertex.roll for vertex in vertices])
        assert rolls[:, 0].mean() == pytest.approx(scene.roll_deg, abs=2.0) and (rolls[:, 1] > 0.0).all()
