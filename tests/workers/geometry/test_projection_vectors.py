"""The file by which the pages' projection is tested says what ``workers/geometry`` says."""

import json

import numpy as np

from apexcal.documents.camera_models import MODELS
from tests.workers.geometry.projection_vectors import FILE, LENSES, pixels_of, points_for, transform


def test_the_vectors_are_of_workers_geometry() -> None:
    cases = json.loads(FILE.read_text())["cases"]
    assert [case["intrinsics"] for case in cases] == LENSES
    assert {case["intrinsics"]["model"] for case in cases} == set(MODELS)
    for case in cases:
        points = np.array(case["points_lidar"])
        assert case["transform"] == transform()
        assert np.array_equal(points, points_for(case["intrinsics"]))
        wanted = pixels_of(case["intrinsics"], points)
        seen = np.array([pixel is not None for pixel in wanted])
        assert [pixel is not None for pixel in case["pixels"]] == seen.tolist()
        # An equidistant lens that never folds sees all around.
        assert case["intrinsics"]["model"] == "kannala_brandt" or 5 < seen.sum() < len(seen)
        given = np.array([pixel for pixel in case["pixels"] if pixel], float)
        assert np.abs(given - np.array([pixel for pixel in wanted if pixel])).max() < 1e-9
