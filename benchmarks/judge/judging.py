"""One draw by the product's own path: planned, searched, finished, held out, judged; and how wrong it is."""

from __future__ import annotations

import sys
import traceback
from typing import Any, Final, NamedTuple
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.calibrations import CalibrationTemplate
from apexcal.documents.checks import USE_LIMIT_M, USE_LIMIT_PX, USE_LIMIT_RAD, Check, CheckVerdict, verdict_of
from apexcal.documents.errors import DocumentError
from apexcal.documents.results import FitResult
from apexcal.geometry.rotations import rotation_from_vector
from apexcal.geometry.se3 import SE3, from_document
from benchmarks.judge.cases import CASES, Case, Draw, Random
from benchmarks.judge.walk_cases import WALKS
from service.calibrations.plan import CalibrationPlan, FitPlan, plan_request
from service.calibrations.resolve import CameraPairs
from service.platform.db.calibrations import FULL, CorrespondenceSet
from service.platform.db.fleets import RigCamera
from service.platform.http.problems import Problem
from workers.geometry.models import INTRINSICS, parse_model
from workers.geometry.projection import project
from workers.geometry.spherical import axes
from workers.judge.calibration_checks import checks_of_calibration
from workers.judge.held_out_check import held_out_pairs
from workers.judge.topics import LOOK_RATE
from workers.models.summary import CameraFit, camera_summary
from workers.simulation.camera import FRONT
from workers.solver.narrowing import SearchState, run_search
from workers.solver.outcomes import SolveError
from workers.solver.prediction import DISTANCES_M
from workers.tasks.run_inputs import RunInput, read_run
from workers.tasks.solving import solved

Floats = NDArray[np.float64]
MOUNT: Final = ("rotation_x", "rotation_y", "rotation_z", "t_x", "t_y", "t_z")
_STEP: Final = 1e-3
DISTANCE_M: Final = 20.0
SIGMAS: Final = 3.0
BROKEN: Final = "broken"
"""The verdict of a draw on which the product itself failed; the bench then ends with 1."""
# Of the points over the field that marks cover: beyond their middle 95 % lie single marks at the image's edges.
_POINTS: Final = 0.05
_NORMAL95: Final = 1.96
_AXES: Final = {"tip_across_mm": 0, "tip_up_mm": 1, "range_mm": 2}
ALL: Final = (*CASES, *WALKS)
CAUSES: Final = ("clock", "rolling_shutter", "lens_model", "stated_lens", "priors", "people")


class Outcome(NamedTuple):
    """How a draw ended. verdict: of the checks, `refused` if there is no result, or `broken`. error_px: RMS at 20 m
    over the field that marks cover; is_wrong: by more than is stated, and than use allows. failed: verdicts by check.
    over_limit: error of the middle 95 % of the points over what use allows; held: share of the points' coordinates
    that lie within their stated 95 % intervals; at_use: as over_limit, at the worst of 5, 20 and 50 m;
    named: causes that checks tell, also where these pass.
    """

    case: str
    verdict: CheckVerdict | str
    error_px: float
    is_wrong: bool
    failed: dict[str, str]
    over_limit: float = np.inf
    held: float = 0.0
    named: tuple[str, ...] = ()
    at_use: float = np.inf


def outcome(case: Case, seed: int, with_folds: bool = True) -> Outcome:
    """Draw the case and judge it as the service does.

    Without `with_folds` no pairs are held out of a fit whose own checks already keep it from being published.
    """
    random = np.random.default_rng([seed, 67])
    draw = case.make(seed, random)
    try:
        draw = as_stated(draw, random) if case.is_sound else draw
        result, checks = calibrated(draw, with_folds)
    except (DocumentError, Problem, SolveError):
        return Outcome(case.name, "refused", np.nan, False, {})
    failed = {check.name: check.verdict for check in checks if check.is_doubt}
    error = error_of(draw, result)
    named = tuple(check.name for check in checks if check.name in CAUSES and _is_told(check))
    verdict = verdict_of(checks, "mount_with_lens")
    return Outcome(
        case.name, verdict, error.px, error.is_wrong, failed, error.over_limit, error.held, named, error.at_use
    )


def _is_told(check: Check) -> bool:
    probability = check.figures.get("probability")
    return check.is_doubt or (check.verdict == "pass" and probability is not None and probability < LOOK_RATE)


def numbered(asked: tuple[int, int, bool]) -> Outcome:
    """The outcome of a case by its number, for a process of its own: number, seed, and `with_folds`."""
    number, seed, with_folds = asked
    try:
        return outcome(ALL[number], seed, with_folds)
    except Exception:
        print(f"{ALL[number].name}, seed {seed}: the fit broke\n{traceback.format_exc()}", file=sys.stderr)
        return Outcome(ALL[number].name, BROKEN, np.nan, False, {})


class Searched(NamedTuple):
    """The one fit that was asked for, its pairs, the end of its search, and its result."""

    plan: FitPlan
    whole: RunInput
    state: SearchState
    result: FitResult


def searched(draw: Draw) -> Searched:
    """Search and fit as the service does. Raises what the product raises."""
    (fit,) = planned(draw).fits
    whole = read_run(fit.of_fold(FULL), FULL, draw.known)
    state = run_search(whole.problem)
    return Searched(fit, whole, state, solved(whole, state))


def calibrated(draw: Draw, with_folds: bool) -> tuple[FitResult, list[Check]]:
    """The result of the one model that was asked for, and all of its checks. Raises what the product raises."""
    fit, whole, state, result = searched(draw)
    if not with_folds and verdict_of(result.checks, "mount_with_lens") != "pass":
        return result, result.checks
    folds = [solved(read_run(fit.of_fold(fold), fold, draw.known), state) for fold in range(fit.request.folds)]
    summary = camera_summary(
        [CameraFit(uuid4(), None, result), *(CameraFit(uuid4(), *one) for one in enumerate(folds))]
    )
    pairs = held_out_pairs(result, folds, whole.problem.points)
    return result, result.checks + checks_of_calibration(
        result, camera=FRONT, summary=summary, ended_well=True, pairs=pairs
    )


def as_stated(draw: Draw, random: Random) -> Draw:
    """The draw with errors that all pairs share (tip, range, elevation), as large as its request states."""
    sigmas: dict[str, Any] = dict(planned(draw).fits[0].request.common_errors)
    xyz = np.column_stack([draw.known[name] for name in "xyz"])
    along = axes(xyz)
    moved = np.radians(random.normal(0.0, sigmas.get("elevation_deg", 0.0))) * along[:, :, 1]
    for name, axis in _AXES.items():
        unit = along[:, :, axis] / np.linalg.norm(along[:, :, axis], axis=1, keepdims=True)
        moved = moved + 1e-3 * random.normal(0.0, sigmas.get(name, 0.0)) * unit
    return draw._replace(known=draw.known | dict(zip("xyz", (xyz + moved).T.tolist(), strict=True)))


def planned(draw: Draw) -> CalibrationPlan:
    """The fits that the service plans for a draw."""
    paired, known = draw.paired, draw.known
    width, height = paired.camera.image_size
    camera = RigCamera(name=FRONT, image_width=width, image_height=height, nominal=paired.nominal, bounds={})
    pairs = CorrespondenceSet(
        pairs=known, count=len(known["x"]), notes=[], source="import" if paired.is_still else "annotations"
    )
    return plan_request(CalibrationTemplate.model_validate(draw.request), [CameraPairs(camera, pairs)])


class PointError(NamedTuple):
    """Of points at 20 m: RMS error, px; whether more of them than edges explain are wrong; and as `Outcome`."""

    px: float
    is_wrong: bool
    over_limit: float
    held: float
    at_use: float


def error_of(draw: Draw, result: FitResult) -> PointError:
    """Return how far a result puts points at 20 m from where they are, over the field that marks cover."""
    camera, points = draw.paired.camera, _points(draw, DISTANCE_M)
    apart = _apart(draw, result, points)
    off = np.hypot(*apart.T)
    covariance = result.covariance
    J = np.stack([derivative(result, name, points) for name in covariance.names], axis=2)
    by_axis = np.nan_to_num(np.sqrt(np.maximum(np.einsum("nij,jk,nik->ni", J, np.array(covariance.matrix), J), 0.0)))
    stated = np.hypot(*by_axis.T)
    focal = float(np.sqrt(camera.intrinsics["f_x"] * camera.intrinsics["f_y"]))
    limit_px = max(USE_LIMIT_PX, USE_LIMIT_RAD * focal)
    wrong = (off > SIGMAS * stated) & (off > limit_px)
    at_use = [
        np.quantile(np.hypot(*_apart(draw, result, _points(draw, far)).T), 1.0 - _POINTS)
        / max(limit_px, focal * USE_LIMIT_M / far)
        for far in DISTANCES_M
    ]
    return PointError(
        float(np.sqrt(np.mean(np.minimum(off, 1e4) ** 2))),
        bool(np.mean(wrong) > _POINTS),
        float(np.quantile(off, 1.0 - _POINTS)) / limit_px,
        float(np.mean(np.abs(apart) <= _NORMAL95 * by_axis)),
        float(max(at_use)),
    )


def _points(draw: Draw, distance_m: float) -> Floats:
    """(N, 3) points that far from the camera, over the field that marks cover."""
    centre = draw.paired.camera.centre()
    towards = draw.paired.places(draw.paired.taken_ns)[::3] - centre
    return centre + distance_m * towards / np.linalg.norm(towards, axis=1, keepdims=True)


def _apart(draw: Draw, result: FitResult, points: Floats) -> Floats:
    truth = draw.paired.camera.project(_at_the_end(draw, points))
    return np.nan_to_num(projected(result, points) - truth, nan=1e4)


def _at_the_end(draw: Draw, points: Floats) -> Floats:
    """The points as the mount of the walk's end sees them, if it turned."""
    angle = np.radians(draw.turned_deg)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    return points @ turn.T


def projected(result: FitResult, points: Floats) -> Floats:
    lens = result.intrinsics
    return project(parse_model(lens.model), lens.by_name(), from_document(result.transform).apply(points))[0]


def derivative(result: FitResult, key: str, points: Floats) -> Floats:
    """(N, 2) px by a person's unit of one parameter, by central differences."""
    step = _STEP * max(abs(result.std[key] or 1.0), 1e-9)
    return (_moved(result, key, step, points) - _moved(result, key, -step, points)) / (2.0 * step)


def _moved(result: FitResult, key: str, step: float, points: Floats) -> Floats:
    mount, lens, model = from_document(result.transform), result.intrinsics.by_name(), parse_model(result.model)
    if key in INTRINSICS[model]:
        lens[key] += step
    elif key.startswith("t_"):
        t = mount.t.copy()
        t[MOUNT.index(key) - 3] += step
        mount = SE3(mount.to_frame, mount.from_frame, mount.R, t)
    else:
        turn = np.zeros(3)
        turn[MOUNT.index(key)] = np.radians(step)
        mount = SE3(mount.to_frame, mount.from_frame, rotation_from_vector(turn) @ mount.R, mount.t)
    return project(model, lens, mount.apply(points))[0]
