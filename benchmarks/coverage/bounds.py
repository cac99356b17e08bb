# pyright: reportMissingTypeStubs=false
"""What the pairs can tell at best of a mount that turned in the middle of a walk."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import special

from benchmarks.coverage.calibrations import Calibration
from workers.solver.error_model import weighed
from workers.solver.estimate import estimate
from workers.solver.residuals import residuals_and_jacobian, transform_of
from workers.solver.weighting import whitened

Floats = NDArray[np.float64]
# scipy publishes no types.
_f_quantile: Callable[[float, float, float], float] = special.fdtri
_noncentral_f: Callable[[float, float, float, float], float] = special.ncfdtr
FALSE_ALARMS: Final = 0.05
"""Share of sound recordings that may be accused."""


def turn_bound(done: Calibration) -> float:
    """The power of the likelihood-ratio test for a turn about any axis, with independent errors alone.

    It knows the true lens model and when the mount turned, and accuses `FALSE_ALARMS` of sound recordings. Lens and
    mount are unknown. No test that treats all axes alike has more power (linearised; noncentral F distribution).
    """
    lens = done.paired.camera.model
    problem, polished = done.problems[lens], done.results[lens].polished.parameters
    found = estimate(problem, np.array([polished[name] for name in problem.names]))
    if found.plain is None:
        return 0.0
    here = whitened(found.holding, found.held_at)
    turns = residuals_and_jacobian(here, found.held_at, local=True)[1].reshape(len(here.points), 2, -1)[:, :, :3]
    late = done.paired.taken_ns > np.median(done.paired.taken_ns)
    wider = found.plain.of_pairs().with_columns(weighed(here, np.where(late, 1.0, 0.0)[:, None, None] * turns))
    # The turn is about the LiDAR's vertical; the columns are about the camera's axes.
    turn: Floats = np.radians(done.errors.second_half_deg) * transform_of(here, found.held_at).R[:, 2]
    strength = float(turn @ np.linalg.solve(wider.covariance()[-3:, -3:], turn))
    freedom = float(found.spread.freedom or 1e6) - 3.0
    return 1.0 - float(_noncentral_f(3.0, freedom, strength, _f_quantile(3.0, freedom, 1.0 - FALSE_ALARMS)))
