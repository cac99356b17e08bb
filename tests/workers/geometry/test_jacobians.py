import numpy as np
import pytest

from workers.geometry.models import MODELS
from workers.geometry.projection import project
from workers.geometry.projections.table import PROJECTIONS

LENSES = {
    "pinhole": [700, 710, 640, 360],
    "brown_conrady": [700, 710, 640, 360, 0.02, -0.2, 0.05, 0.001, -0.002, 0.01],
    "kannala_brandt": [700, 710, 640, 360, -0.05, -0.078, 0.096, -0.0515],
}


@pytest.mark.parametrize("model", MODELS)
def test_derivatives_are_those_of_the_projection(model):
    points = np.random.default_rng(1).uniform([-3, -2, 3], [3, 2, 10], (60, 3))
    points[0] = 0, 0, 5
    lens, step = np.array(LENSES[model], dtype=float), 1e-6
    assert not project(model, lens, points)[1].any()
    by_point, by_intrinsics = np.empty((60, 2, 3)), np.empty((60, 2, len(lens)))
    PROJECTIONS[model].jacobians_into(lens, points, by_point, by_intrinsics)
    for j in range(3):
        d = step * np.eye(3)[j]
        difference = project(model, lens, points + d)[0] - project(model, lens, points - d)[0]
        np.testing.assert_allclose(by_point[:, :, j], difference / (2 * step), atol=1e-6)
    for j in range(len(lens)):
        d = step * np.eye(len(lens))[j]
        difference = project(model, lens + d, points)[0] - project(model, lens - d, points)[0]
        np.testing.assert_allclose(by_intrinsics[:, :, j], difference / (2 * step), atol=1e-6)
