"""A pattern is tested as further unknowns of the fit, computed again with NumPy."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from tests.workers.judge.fits import rig
from tests.workers.solver.rigs import SIZE
from workers.judge.causes import find_causes, lens_patterns
from workers.judge.lens_checks import lens_model
from workers.judge.residual_patterns import pattern_test
from workers.solver.error_model import linearised
from workers.solver.estimate import estimate
from workers.solver.residuals import predict


def test_the_pattern_of_a_lens_is_least_squares_of_the_residuals():
    """Combinations that the parameters themselves do to 98 % are left out."""
    problem, start = rig("pinhole")
    found = estimate(replace(problem, blocks=None), np.array(start))
    away = (predict(found.holding, found.held_at)[0] - found.held_at[8:10]) / (0.5 * np.hypot(*SIZE))
    x, y = away.T
    radial = away[:, :, None] * np.stack([np.hypot(x, y) ** power for power in range(7)], axis=1)[:, None]
    decentred = np.array([[3 * x * x + y * y, 2 * x * y], [2 * x * y, x * x + 3 * y * y]]).transpose(2, 1, 0)
    patterns = np.concatenate([radial, decentred], axis=2)
    np.testing.assert_allclose(lens_patterns(found.holding, found.held_at), patterns, atol=1e-12)
    fit = linearised(found.holding, found.held_at)[0]
    residual, J = fit.residuals.ravel(), fit.jacobian.reshape(fit.residuals.size, -1)
    J, G = (each / np.linalg.norm(each, axis=0) for each in (J, patterns.reshape(len(residual), -1)))
    basis = np.linalg.qr(J)[0]
    _, left, turn = np.linalg.svd(G - basis @ (basis.T @ G), full_matrices=False)
    G = G @ turn[left > 0.02].T
    both, count, freedom = np.column_stack([J, G]), G.shape[1], len(residual) - J.shape[1]
    whole = np.linalg.lstsq(both, -residual)[0]
    step = whole[-count:]
    C = residual @ residual / freedom * np.linalg.inv(both.T @ both)[-count:, -count:]
    test = pattern_test(found, patterns)
    assert count >= 3
    assert test.probability == pytest.approx(
        stats.f.sf(step @ np.linalg.solve(C, step) / count, count, freedom), rel=1e-4
    )
    # The lens's own parameters take back most of what the terms alone would do.
    np.testing.assert_allclose(test.pattern.ravel(), both @ whole, atol=1e-4)
    assert np.abs(test.pattern).max() < 0.3 * np.abs(G @ step).max()
    figures = lens_model(found, find_causes(found)).figures
    size = np.hypot(*test.pattern.T)
    assert figures["probability"] == pytest.approx(test.probability)
    assert figures["pattern_px"] == pytest.approx(np.quantile(size, 0.99))
    camera = problem.points @ np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]).T
    angle = np.degrees(np.arctan2(np.hypot(*camera[:, :2].T), camera[:, 2]))
    assert size[np.argmin(np.abs(angle - figures["pattern_at_deg"]))] == pytest.approx(figures["pattern_px"], rel=0.1)
