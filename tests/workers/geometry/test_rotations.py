import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from apexcal.geometry.rotations import rotation_from_euler, rotation_from_vector
from workers.geometry.rotations import axes_of_euler, axes_of_vector, rows_from_euler, rows_from_vector

angle = st.floats(-3.2, 3.2)
angles = st.tuples(angle, angle, angle)


@settings(deadline=None)
@given(angles)
def test_compiled_rows_agree(abc):
    np.testing.assert_allclose(np.reshape(rows_from_vector(*abc), (3, 3)), rotation_from_vector(abc), atol=1e-12)
    np.testing.assert_allclose(np.reshape(rows_from_euler(*abc), (3, 3)), rotation_from_euler(abc), atol=1e-12)


@settings(deadline=None)
@given(angles)
def test_axes_are_the_derivative_of_the_rotation(abc):
    point, step = np.array([0.3, -0.7, 0.5]), 1e-6
    for rows, axes in ((rows_from_vector, axes_of_vector(*abc)), (rows_from_euler, axes_of_euler(abc[0], abc[1]))):
        moved = np.reshape(rows(*abc), (3, 3)) @ point
        for i in range(3):
            d = np.zeros(3)
            d[i] = step
            ahead, back = (np.reshape(rows(*(np.array(abc) + s * d)), (3, 3)) @ point for s in (1, -1))
            axis = np.reshape(axes, (3, 3))[:, i]
            np.testing.assert_allclose(np.cross(axis, moved), (ahead - back) / (2 * step), atol=1e-8)


@pytest.mark.parametrize("shared", [rows_from_vector, rows_from_euler])
def test_bits_do_not_depend_on_who_was_compiled_first(shared):
    def nine(inner):
        return lambda v: inner(v[0], v[1], v[2])

    vectors = np.random.default_rng(0).normal(size=(300, 3))
    said = {name: shared.targetoptions[name] for name in ("nogil", "error_model", "fastmath")}
    afresh = [njit(**said)(shared.py_func) for _ in range(2)]
    hasty = njit(fastmath=True)(nine(afresh[0]))
    hasty(vectors[0])
    plain = [njit(nine(one)) for one in afresh]
    assert [plain[0](v) for v in vectors] == [plain[1](v) for v in vectors]
