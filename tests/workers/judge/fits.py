"""Fits of pairs that fill the image, sound but for what a test plants."""

from dataclasses import replace

import numpy as np

from apexcal.documents.fit_requests import fit_request
from apexcal.geometry.rotations import FORWARD_LIDAR_TO_OPTICAL
from tests.workers.solver.rigs import DISTORTION, NOMINAL, SIZE
from tests.workers.solver.walks import ended
from workers.geometry.models import INTRINSICS
from workers.geometry.projection import project, unproject
from workers.judge.fit_checks import checks_of_fit
from workers.solver.blocks import blocks_of
from workers.solver.problem import fit_problem

FOCAL_PX = 700.0


def lens_of(model, seed=1):
    rng = np.random.default_rng((seed, 3))
    plain = [FOCAL_PX, 1.01 * FOCAL_PX, *(np.array(SIZE) / 2 + rng.normal(size=2) * 10)]
    return np.array(plain + DISTORTION[model])


def rig(lens="brown_conrady", seed=1, pairs=222, noise_px=1.0, *, model=None, edit=None, **request):
    """(problem, start): vertices of a walk up and down the field, in order of time; outliers are left out.

    `edit(points, pixels, rng)` changes points (N, 3) and noiseless marks (N, 2) in place. `model`: of the fit.
    """
    rng = np.random.default_rng(seed)
    lens_values = lens_of(lens, seed)
    marks = rng.uniform((0.04 * SIZE[0], 0.1 * SIZE[1]), (0.96 * SIZE[0], 0.9 * SIZE[1]), (pairs, 2))
    rays, _ = unproject(lens, dict(zip(_names(lens), lens_values, strict=True)), marks)
    points = (rays * rng.uniform(4.0, 25.0, (pairs, 1))) @ FORWARD_LIDAR_TO_OPTICAL
    order = np.lexsort((points[:, 1], np.floor(points[:, 0] / 2.0)))
    points = points[order]
    pixels = project(lens, lens_values, points @ FORWARD_LIDAR_TO_OPTICAL.T)[0]
    if edit is not None:
        edit(points, pixels, rng)
    pixels = pixels + noise_px * rng.normal(size=pixels.shape)
    model = model or lens
    given = {"model": model, "image_size": SIZE, "nominal": NOMINAL, **request}
    problem = fit_problem(fit_request(**given), points, pixels)
    start = dict(zip(_names(lens), lens_values.tolist(), strict=True))
    blocks = blocks_of({"x": points[:, 0], "stamp_ns": np.arange(pairs) * 400_000_000})
    return replace(problem, blocks=blocks), [start.get(name, 0.0) for name in problem.names]


def _names(model):
    return INTRINSICS[model]


def checked(problem, start, **pairs):
    """The checks of a fit, by name."""
    found, result = ended(problem, start)
    return {check.name: check for check in checks_of_fit(found, result, pairs=pairs)}


def failed(checks):
    """Names and verdicts of the checks that do not pass, but for the mount alone."""
    return {
        name: check.verdict for name, check in checks.items() if check.is_doubt and check.scope == "mount_with_lens"
    }
