"""Cells at the level of pairs: fresh rigs, walks and marks, with errors drawn from the cell's own law.

Each fit starts at the truth, because searches end in the same optimum wherever they start (`make bench-accuracy`).
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from apexcal.geometry.rotations import vector_from_rotation
from benchmarks.coverage.marks import Errors
from benchmarks.judge.cases import Draw, Random, drawn, random_lens
from benchmarks.judge.judging import MOUNT, planned
from benchmarks.judge.pairs import draw_pairs
from service.platform.db.calibrations import FULL
from workers.geometry.models import INTRINSICS
from workers.geometry.projection import project
from workers.geometry.spherical import axes
from workers.judge.effects import marked_rays, worst_axis
from workers.solver.estimate import Estimate, estimate
from workers.solver.halves import halves_of
from workers.solver.prediction import DISTANCES_M, covariances_along
from workers.solver.problem import FitProblem
from workers.solver.residuals import transform_of
from workers.solver.rolling_shutter import rolling_shutter
from workers.tasks.run_inputs import read_run

Floats = NDArray[np.float64]
_EDGE_MM: Final = 3.5  # EN 315
_WORN_MM: Final = (5.0, 8.0)
_CLOCK_MS: Final = 10.0
_LINE_TIME_US: Final = 26.0
_DENSE: Final = (600, 700)
_EVERY_SWEEP: Final = (1000, 1300)
_MEASURED: Final = {"tip_across_mm": 0.0, "tip_up_mm": 0.0, "range_mm": 0.0}
GROSS: Final = 3.0
"""Standard deviations."""


class DrawScore(NamedTuple):
    """One draw: which intervals of the mount hold, by name; of pixels, (distances,) shares; the z of the mount's
    parameters; whether halves accuse the pairs; and the line time told, its deviation, and whether it is shown.
    """

    mount: dict[str, bool]
    pixels: list[float]
    z: list[float]
    is_accused: bool
    line_time: tuple[float, float, bool] | None


def _plain(errors: Errors = Errors(), lasting: float = 0.0, **pairs: Any) -> Callable[[int, Random], Draw]:
    def draw(seed: int, random: Random) -> Draw:
        paired = draw_pairs(seed, random_lens(random), lasting=lasting, **pairs)
        return drawn(paired, errors, random, common_errors=_MEASURED)

    return draw


def _shared_edges(seed: int, random: Random) -> Draw:
    draw = _plain()(seed, random)
    whole = {"tip_across_mm": _EDGE_MM, "tip_up_mm": _EDGE_MM}
    return _moved(draw, *random.normal(0.0, _EDGE_MM, 2))._replace(request=draw.request | {"common_errors": whole})


def _worn_tip(seed: int, random: Random) -> Draw:
    draw = _plain()(seed, random)
    across_mm, up_mm = random.normal(0.0, _EDGE_MM, 2)
    worn = _moved(draw, across_mm, up_mm + float(random.uniform(*_WORN_MM)))
    return worn._replace(request=draw.request | {"common_errors": {}})


def _moved(draw: Draw, across_mm: float, up_mm: float) -> Draw:
    points = np.column_stack([draw.known[name] for name in "xyz"])
    # Along an arc a radian is as long as the distance.
    turns = 1e-3 * np.array([across_mm, up_mm]) / np.linalg.norm(points, axis=1, keepdims=True)
    points = points + np.einsum("nij,nj->ni", axes(points)[:, :, :2], turns)
    return draw._replace(known=draw.known | dict(zip("xyz", points.T.tolist(), strict=True)))


def _clock(seed: int, random: Random) -> Draw:
    late_ms = float(random.normal(0.0, _CLOCK_MS))
    paired = draw_pairs(seed, random_lens(random), late_ms=late_ms, lasting=0.0, pairs=_DENSE)
    return drawn(paired, Errors(), random, common_errors=_MEASURED | {"clock_ms": _CLOCK_MS})


def _shutter(seed: int, random: Random) -> Draw:
    # An offset of the clocks that the same marks told has absorbed what all rows share.
    lens = random_lens(random)
    paired = draw_pairs(seed, lens, lasting=0.0, pairs=_DENSE)
    rows = paired.camera.project(paired.places(paired.taken_ns))[:, 1] - 0.5 * paired.camera.image_size[1]
    late_ms = 1e-3 * _LINE_TIME_US * float(np.mean(rows))
    paired = draw_pairs(seed, lens, late_ms=late_ms, lasting=0.0, pairs=_DENSE)
    return drawn(paired, Errors(line_time_us=_LINE_TIME_US), random, common_errors=_MEASURED)


CELLS: Final[dict[str, Callable[[int, Random], Draw]]] = {
    "clean": _plain(),
    "2 % wrong": _plain(Errors(blunders=0.02)),
    "15 % wrong": _plain(Errors(blunders=0.15)),
    "shared edges": _shared_edges,
    "worn tip": _worn_tip,
    "lasting errors": _plain(lasting=0.9, pairs=_EVERY_SWEEP),
    "few pairs": _plain(pairs=(40, 60)),
    "clock from few marks": _clock,
    "rolling shutter": _shutter,
    "flat walk": _plain(heights_m=0.03),
}


def draw_score(numbered: tuple[str, int]) -> DrawScore | None:
    """The draw of a cell with that seed; None if the pairs leave a direction open."""
    cell, seed = numbered
    return score(CELLS[cell](seed, np.random.default_rng([seed, 71])))


def score(draw: Draw) -> DrawScore | None:
    """What a draw's fit states against its truth; None if the pairs leave a direction open."""
    (fit,) = planned(draw).fits
    problem = read_run(fit.of_fold(FULL), FULL, draw.known).problem
    truth = true_parameters(draw, problem)
    fitted = estimate(problem, truth)
    if fitted.errors is None:
        return None
    spread = fitted.spread
    error = fitted.parameters - truth
    turn = fitted_turn(draw, problem, fitted)
    by_name = dict(zip(MOUNT, [*np.degrees(turn), *error[3:6]], strict=True))
    half = dict(zip(spread.names, spread.half_width95.tolist(), strict=True))
    std = dict(zip(spread.names, spread.std.tolist(), strict=True))
    shutter = rolling_shutter(fitted)
    return DrawScore(
        {name: abs(by_name[name]) <= half[name] for name in MOUNT},
        _pixels(draw, fitted),
        [by_name[name] / std[name] for name in MOUNT],
        not all(split.holds for split in halves_of(fitted)),
        shutter and (shutter.line_time_us, shutter.std_us, shutter.shown),
    )


def true_parameters(draw: Draw, problem: FitProblem) -> Floats:
    """(D,) the parameters that made the draw."""
    camera = draw.paired.camera
    turn = vector_from_rotation(camera.T_camera_lidar.R @ problem.nominal.R.T)
    lens = [camera.intrinsics.get(name, 0.0) for name in INTRINSICS[problem.model]]
    return np.concatenate([turn, camera.T_camera_lidar.t, lens])


def fitted_turn(draw: Draw, problem: FitProblem, fitted: Estimate) -> Floats:
    """(3,) rad by which the estimate is turned, about the camera's axes."""
    return vector_from_rotation(transform_of(problem, fitted.parameters).R @ draw.paired.camera.T_camera_lidar.R.T)


def _pixels(draw: Draw, fitted: Estimate) -> list[float]:
    """Share of a pixel's intervals that hold at each distance, along u and v, over the field that marks cover."""
    rays = marked_rays(fitted)
    px, _ = covariances_along(fitted, rays)
    factors = special.stdtrit(np.clip(worst_axis(fitted).freedoms, 1.0, 1e9), 0.975)
    mount, p = transform_of(fitted.holding, fitted.parameters), fitted.parameters
    shares: list[float] = []
    for index, distance in enumerate(DISTANCES_M):
        points = mount.inverse().apply(distance * rays)
        here = project(fitted.holding.model, p[6:], distance * rays)[0]
        error = np.abs(here - draw.paired.camera.project(points))
        half = factors[index][:, None] * np.sqrt(np.einsum("ncc->nc", px[index]))
        shares.append(float(np.mean(error <= half)))
    return shares


def summary(cell: str, draws: Sequence[DrawScore | None]) -> dict[str, Any]:
    """The figures of a cell."""
    seen = [draw for draw in draws if draw is not None]
    mount = {name: float(np.mean([draw.mount[name] for draw in seen])) for name in MOUNT}
    z = np.array([draw.z for draw in seen])
    pixels = np.mean([draw.pixels for draw in seen], axis=0).tolist()
    figures: dict[str, Any] = {
        "draws": len(draws),
        "open": len(draws) - len(seen),
        **mount,
        **{f"{distance:g} m": share for distance, share in zip(DISTANCES_M, pixels, strict=True)},
        "gross": float(np.mean(np.abs(z) > GROSS)),
        "rms z": float(np.sqrt(np.mean(z**2))),
        "accused": float(np.mean([draw.is_accused for draw in seen])),
    }
    lines = [draw.line_time for draw in seen if draw.line_time is not None]
    if 2 * len(lines) > len(seen):
        true = _LINE_TIME_US if "shutter" in cell else 0.0
        figures |= {
            "line_us": float(np.median([line for line, _, _ in lines])),
            "line_std_us": float(np.median([std for _, std, _ in lines])),
            "line_within_2": float(np.mean([abs(line - true) <= 2.0 * std for line, std, _ in lines])),
            "line_shown": float(np.mean([shown for _, _, shown in lines])),
        }
    rounded = {name: round(value, 3) if isinstance(value, float) else value for name, value in figures.items()}
    print(f"{cell:22}" + " ".join(f"{name} {value}" for name, value in rounded.items()), file=sys.stderr)
    return rounded
