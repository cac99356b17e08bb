"""Deviation and interval of every parameter come from one covariance, whatever widens it."""

import numpy as np
import pytest
from scipy import stats

from apexcal.documents.camera_models import MODELS
from tests.workers.judge.fits import rig
from tests.workers.solver.walks import ended
from workers.solver.uncertainty import units_of


def wrong_marks(points, pixels, rng):
    pixels[rng.uniform(size=len(pixels)) < 0.1, 1] += 60.0


def alike(points, pixels, rng):
    """Stretches of a walk err together."""
    pixels += np.repeat(rng.normal(size=(1 + len(pixels) // 8, 2)), 8, axis=0)[: len(pixels)]


WIDENED = {
    "nothing": {},
    "wrong marks that are kept": {"edit": wrong_marks, "outliers": "keep"},
    "stretches of a walk": {"edit": alike},
    "what all pairs share": {"common_errors": {"elevation_deg": 0.05, "person_px": 0.5}},
    "few pairs": {"pairs": 24},
}


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("by", WIDENED)
def test_each_interval_is_students_of_its_own_deviation(model, by):
    found, result = ended(*rig(model, **WIDENED[by]))
    spread = found.spread
    free, unit = slice(len(spread.names)), units_of(spread.names)
    std = np.array([result.std[name] for name in spread.names], np.float64)
    np.testing.assert_allclose(std, np.sqrt(np.diag(np.array(result.covariance.matrix))), rtol=1e-9)
    half = np.array([result.interval95_half_width[name] for name in spread.names], np.float64)
    freedoms = spread.freedoms if spread.freedoms is not None else np.full(len(std), spread.freedom)
    shift = np.zeros(len(std)) if spread.shift is None else spread.shift
    # A fixed shift has no freedom; the rest has all the doubt (Satterthwaite).
    own = np.maximum(freedoms * (1.0 - (shift / std) ** 2) ** 2, 1.0)
    most, fixed = stats.t.ppf(0.975, own) * std, np.abs(shift) > 1e-9 * std
    np.testing.assert_allclose(half[~fixed], most[~fixed], rtol=1e-6)
    assert np.all(half >= (1.0 - 1e-6) * std) and np.all(half <= (1.0 + 1e-6) * most)
    assert found.errors is not None
    if not fixed.any():
        covariance = found.errors.covariance()[free, free] * unit[:, None] * unit
        np.testing.assert_allclose(
            (np.array(result.covariance.matrix) - covariance) / np.outer(std, std), 0.0, atol=1e-3
        )
