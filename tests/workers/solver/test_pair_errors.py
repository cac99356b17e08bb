"""What explains the pairs' residuals, and the fixed points for comparing results."""

from dataclasses import replace

import numpy as np
import pytest

from apexcal.geometry.rotations import rotation_from_vector, vector_from_rotation
from tests.workers.solver.rigs import SIZE, plain, simulated
from workers.solver.narrowing import run_search
from workers.solver.pair_errors import explained_px, marks_outside, paired_apart_ms
from workers.solver.residuals import predict
from workers.solver.solution import finished


@pytest.fixture(scope="module")
def solved():
    problem, truth = simulated("brown_conrady", 11)
    return problem, truth, finished(problem, run_search(problem)).result


def test_the_noise_that_marks_and_vertices_explain(solved):
    problem, _, result = solved
    focal = (result.intrinsics.f_x + result.intrinsics.f_y) / 2
    expected = np.sqrt(1.0 + np.median((focal * 0.016 / np.linalg.norm(problem.points, axis=1)) ** 2))
    assert result.explained_px == explained_px(problem, result.intrinsics, result) == pytest.approx(expected)
    stated = result.model_copy(update={"noise_scale": 1.0, "sigma_px": 9.0})
    assert explained_px(problem, result.intrinsics, stated) == 9.0


def test_marks_outside_of_the_image_are_counted(solved):
    problem, _, _ = solved
    assert marks_outside(problem) == 0
    problem.pixels[:3] += (5000.0, 0.0)
    assert marks_outside(problem) == 3
    problem.pixels[:3] -= (5000.0, 0.0)


def test_the_time_between_vertices_and_their_frames_is_told():
    assert paired_apart_ms({"gap_ns": [-20_000_000, 10_000_000, 0]}) == 10.0
    assert paired_apart_ms({"gap_ns": [0, 0]}) is None and paired_apart_ms({}) is None


def test_the_field_is_where_the_result_puts_fixed_points_with_its_deviations(solved):
    problem, truth, result = solved
    document = plain(result)
    found = document["field"]
    step, per_range = 10, 17 * 36
    number = np.array(found["number"])
    azimuth, elevation = np.radians(-180 + step * (number % 36)), np.radians(-80 + step * (number % per_range // 36))
    r = np.where(number < per_range, 5.0, 20.0)
    points = np.column_stack(
        [r * np.cos(elevation) * np.cos(azimuth), r * np.cos(elevation) * np.sin(azimuth), r * np.sin(elevation)]
    )
    assert len(number) > 20

    def at(p):
        here = replace(problem, points=points, pixels=np.zeros((len(points), 2)), weights=np.ones(len(points)))
        return predict(here, p)[0]

    p = np.array([document["polished"]["parameters"][name] for name in problem.names])
    np.testing.assert_allclose(np.column_stack([found["u"], found["v"]]), at(p), atol=1e-3)
    # Truth lies within the stated deviations, by all points together.
    error = np.hypot(*(at(truth) - at(p)).T) / np.sqrt(2)
    assert np.sqrt(np.mean((error / np.array(found["sigma_px"])) ** 2)) < 2.5
    draws = np.random.default_rng(0).multivariate_normal(np.zeros(16), document["covariance"]["matrix"], 400)

    def moved(d):
        R = rotation_from_vector(np.radians(d[:3])) @ rotation_from_vector(p[:3])
        return at(np.concatenate([vector_from_rotation(R), p[3:] + d[3:]]))

    turned = np.array([moved(d) - at(p) for d in draws * 0.1]) * 10.0
    middle = np.argsort(np.hypot(np.array(found["u"]) - SIZE[0] / 2, np.array(found["v"]) - SIZE[1] / 2))[:10]
    sampled = np.sqrt(np.mean(turned[:, middle] ** 2, axis=(0, 2)))
    np.testing.assert_allclose(sampled, np.array(found["sigma_px"])[middle], rtol=0.15)
