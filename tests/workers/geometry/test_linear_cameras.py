"""A matrix that no camera has is none, and not an error."""

import numpy as np
import pytest

from workers.geometry.linear_cameras import direct_linear_start


@pytest.mark.parametrize("row", [(0.0, 0.0, 900.0), (500.0, 0.0, 900.0)])
def test_a_matrix_of_a_camera_is_read_and_one_that_maps_onto_a_line_is_none(row):
    """Marks that lie above one another leave a first row along the third, and a focal length of zero."""
    P = np.array([[*row, 0.0], [0.0, 700.0, 400.0, 0.0], [0.0, 0.0, 1.0, 2.0]])
    camera = direct_linear_start(0.5).read(P, np.zeros((6, 3)), np.zeros((6, 2)), np.zeros(2))
    assert (camera is None) == (row[0] == 0.0)
    if camera is not None:
        assert camera.intrinsics == pytest.approx({"f_x": 500.0, "f_y": 700.0, "c_x": 900.0, "c_y": 400.0})
        assert camera.t == pytest.approx((-3.6, -8.0 / 7.0, 2.0))
