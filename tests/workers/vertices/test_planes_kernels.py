"""Kernels that put a board's plane together, on what no board gives."""

from __future__ import annotations

import numpy as np

from workers.vertices.refined.planes import find_stretches


def test_each_return_may_be_a_stretch_of_its_own():
    """A fence or leaves: no two neighbours are at one range. Only the plain function checks its bounds."""
    distance = np.tile([5.0, 7.0], (2, 20))
    azimuth = np.tile(np.radians(0.2) * np.arange(40), (2, 1))
    asked = azimuth, distance, np.ones((2, 40), np.bool_), 0.02, np.full(2, np.radians(0.2))
    found = find_stretches.py_func(*asked)
    assert found.shape == (80, 7)
    np.testing.assert_allclose(find_stretches(*asked), found)
