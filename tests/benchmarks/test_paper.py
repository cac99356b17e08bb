"""The paper's experiment: with a perfect detector and known clocks nothing is left but the clicks."""

import numpy as np
import pytest

from benchmarks.paper.fits import errors_of_truth, errors_on, fit, weights_of
from benchmarks.paper.pairs import OFFSET_NS, make_pairs
from benchmarks.paper.recordings import Walked, Wanted, camera_of, field_points
from workers.simulation.rig import START_NS
from workers.simulation.truth import scan_times_s
from workers.vertices.vertex import Vertex


def perfect(name, seed, sweeps=2400):
    """A walk whose vertices are the true apex, at the moment at which the sensor looked there."""
    walked = Walked(Wanted(name, seed, 222, sweeps, sweeps), {"refined": []})
    when_s = scan_times_s(walked.rig, np.arange(1, sweeps - 30) * 0.1)
    apex = walked.rig.walk.poses(when_s).apex
    sure = ((1e-9, 0.0, 0.0), (0.0, 1e-9, 0.0), (0.0, 0.0, 1e-6))
    walked.vertices["refined"] = [
        Vertex(tuple(xyz), START_NS + round(at * 1e9), 0, number, 1, "refined", sure)
        for number, (at, xyz) in enumerate(zip(when_s.tolist(), apex.tolist(), strict=True))
    ]
    return walked


def test_a_perfect_detector_leaves_the_clicks_alone():
    camera = camera_of("brown_conrady", 31)
    train, test = perfect("train", 31), perfect("test", 32)
    nearest, exact = (make_pairs(train, camera, "refined", offset, 0, 0.0) for offset in (None, OFFSET_NS))
    off = [np.linalg.norm(camera.project(one.points) - one.marks, axis=1).mean() for one in (nearest, exact)]
    assert off[0] > 10.0 * off[1] and off[1] < 0.05
    assert len(exact.points) == len(set(exact.stamps_ns.tolist())) == 222
    assert (weights_of(exact, 430.0) > 0.99).all()
    fitted = fit(exact, "brown_conrady", 0)
    assert errors_of_truth(fitted, camera, field_points(train.rig.scene.ground_z)).mean() < 0.05
    clicked, heldout = (make_pairs(walked, camera, "refined", OFFSET_NS, 0) for walked in (train, test))
    assert errors_on(fit(clicked, "brown_conrady", 0), heldout).mean() == pytest.approx(np.sqrt(np.pi / 2), rel=0.2)
