# pyright: reportMissingTypeStubs=false
"""The end of a run: polish, baseline, uncertainty and plain words, as one JSON document."""

import os
import platform
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any, Final, NamedTuple

import numpy as np
from llvmlite import binding
from numpy.typing import ArrayLike, NDArray

from workers.geometry.models import INTRINSICS, parse_model
from workers.geometry.projection import distances_px, image_diagonal_px, project
from workers.geometry.rotations import euler_from_rotation, vector_from_rotation
from workers.geometry.transforms import RigidTransform, from_document, to_document
from workers.solver.baselines import baseline, linear_baseline
from workers.solver.degeneracy import arbitrary, is_determined, point_alarms
from workers.solver.diagnosis import alarms, at_bounds, misfit, several_optima
from workers.solver.errors import SolveError
from workers.solver.estimate import Estimate, estimate
from workers.solver.halves import halves_of, too_small
from workers.solver.polish import Fit, cost_of, distances, mean_and_rms
from workers.solver.prediction import prediction
from workers.solver.problem import FitProblem
from workers.solver.residuals import transform_of
from workers.solver.rolling_shutter import line_time_of
from workers.solver.schedule import State
from workers.solver.stated_lens import lens_origin, under_stated_lens
from workers.solver.weighting import whitened

Floats = NDArray[np.float64]
# llvmlite publishes no types.
_host_cpu_name: Callable[[], str] = binding.get_host_cpu_name
_LIBRARIES: Final = ("apexcal", "numpy", "scipy", "numba", "llvmlite")
_LOSS_WORDS: Final = {"mean": "mean pixel distance", "saturating": "saturating mean pixel distance"}


class Finished(NamedTuple):
    """The end of a fit: its estimate, and the document that it becomes."""

    estimate: Estimate
    document: dict[str, Any]


def solve_finish(problem: FitProblem, state: State) -> dict[str, Any]:
    """Return the document of `finished`."""
    return finished(problem, state).document


def finished(problem: FitProblem, state: State) -> Finished:
    """Polish the search's best and describe everything found, as plain JSON.

    The document's `intrinsics` and `transform` (T_camera_lidar) are the polished ones; `ga`, `polished`,
    `baseline` (least squares from the centre of the bounds) and `linear_baseline` (direct linear transformation
    with RANSAC, then least squares; null where no linear camera fits) stand side by side, each over the pairs that
    it was given (`ga` over all, also where the others leave outliers out), with mean and RMS distance in px, what
    it minimised and its parameters (search form: radians, metres, pixels). `parameters` and `std` are in people's
    units (degrees, metres, pixels). `outliers` names the pairs that the fit of the others rejects; where the problem
    says `exclude` the polish leaves them out, and `kept` has its errors on the rest. `weights` says whether the
    pairs weighed equally or by stated covariances; then `noise_scale` says how many times larger the errors are
    than stated (the deviations here are scaled by it), and `sigma_px` is the noise of a typical pair. `status` is
    `ok`, `unfinished` (the schedule was stopped from outside), `not_converged` (the polish ran out),
    `not_determined` (the pairs leave a free parameter open) or `not_explained` (half of them lie far from
    where it projects them). Of a fit to all pairs `halves` compares the fits of disjoint halves of the pairs,
    `stated_too_small` says in sentences where they differ by more than is stated, and `prediction` has deviations
    over the image; `shared_errors` is what blocks of pairs share, and the deviations count it where it is `counted`;
    `lens` says where the lens comes from, and `stated_lens` has the mount under a stated one (`under_stated_lens`);
    `person_bias` is what was found of the people's biases, and `rolling_shutter` what the residuals show of one
    beyond the stated `line_time_us`. What the pairs do not tell is null or left out, never a number that is none.
    Raises SolveError `bad_schedule` where no iteration was done.
    """
    if not state.best_parameters:
        raise SolveError("bad_schedule", "The run has no iteration to finish from.", "Run at least one.")
    found = estimate(problem, np.array(state.best_parameters))
    polished, outliers, kept, spread = found.fit, found.outliers, found.fitted, found.spread
    p = found.parameters
    plain = {"baseline": baseline(kept), "linear_baseline": linear_baseline(kept)}
    compared = _compared(whitened(kept, p), polished, plain)
    elsewhere = several_optima(kept, state, polished, compared, spread)
    halves = halves_of(found) if problem.fold < 0 else []
    doubts = too_small(halves, problem)
    line_time = line_time_of(found) if problem.fold < 0 else None
    said = found.moved_alarms() + doubts + (found.shared.alarms() if found.shared else [])
    said += line_time.alarms(problem.line_time_us) if line_time else []
    stated = under_stated_lens(problem, found) if problem.fold < 0 else None
    if stated is not None and stated.explains is False:
        way = (
            "" if lens_origin(problem) == "fitted" else " Calibrate with intrinsics_as: free (--intrinsics-as free)."
        )
        said.append(stated.sentence + way)
    transform = transform_of(problem, p)
    unexplained = misfit(problem, p)
    status, message = _status(state, found, unexplained)
    ga_mean, ga_rms = mean_and_rms(problem, state.best_parameters)
    # The alarms compare both stages over the pairs that the polish was given.
    ga_kept_px = mean_and_rms(kept, state.best_parameters)
    excluded = problem.outliers == "exclude"
    document = {
        "model": problem.model,
        "search": problem.search,
        "status": status,
        "message": message,
        "loss": problem.loss,
        "weights": "equal" if problem.covariances is None else "covariances",
        "pairs": int(np.count_nonzero(problem.weights)),
        "free_parameters": len(problem.free),
        "iterations": state.iteration,
        "stopped": state.stopped,
        "evaluations": state.evaluations,
        "history": list(state.history),
        "ga": {
            "mean_px": ga_mean,
            "rms_px": ga_rms,
            "minimised": _LOSS_WORDS[problem.loss],
            "loss_px": state.best_loss,
            "parameters": _named(problem, state.best_parameters),
        },
        "polished": _fit_document(problem, polished),
        **{name: None if fit is None else _fit_document(problem, fit) for name, fit in plain.items()},
        "kept": _kept_document(kept, p),
        "outliers": [outlier.to_document(excluded) for outlier in outliers],
        "parameters": people_parameters(problem, p, transform),
        "intrinsics": intrinsics_document(problem, p),
        "transform": to_document(transform),
        "lens": lens_origin(problem),
        "stated_lens": stated and stated.model_dump(exclude_none=False),
        "residuals_px": distances(problem, p).tolist(),
        "at_bounds": at_bounds(problem, p),
        **spread.to_document(),
        "alarms": unexplained + alarms(kept, ga_kept_px, polished, elsewhere, spread, outliers, excluded) + said,
        "shared_errors": found.shared and found.shared.to_document(),
        "common_errors": problem.common_errors,
        "person_bias": found.bias and found.bias._asdict(),
        "line_time_us": problem.line_time_us,
        "rolling_shutter": line_time and line_time.to_document(),
        "weak_priors": dict(found.weak),
        "halves": [one.model_dump() for one in halves],
        "stated_too_small": doubts,
        "prediction": prediction(found, halves) if problem.fold < 0 else None,
        "several_optima": elsewhere,
        "cpu": cpu_document(),
        "versions": versions_document(),
    }
    return Finished(found, document)


def _compared(problem: FitProblem, polished: Fit, plain: Mapping[str, Fit | None]) -> dict[str, tuple[Fit, float]]:
    words = {
        "baseline": "Plain least squares from the centre of the bounds",
        "linear_baseline": "Least squares from a linear start with RANSAC",
    }
    lowest = cost_of(problem, polished.parameters, polished.scale_px)
    return {
        words[name]: (fit, cost_of(problem, fit.parameters, polished.scale_px) / lowest if lowest > 0.0 else 1.0)
        for name, fit in plain.items()
        if fit is not None
    }


def _kept_document(problem: FitProblem, p: Floats) -> dict[str, Any]:
    mean, rms = mean_and_rms(problem, p)
    return {"pairs": int(np.count_nonzero(problem.weights)), "mean_px": mean, "rms_px": rms}


def evaluate(
    intrinsics: Mapping[str, Any], transform: Mapping[str, Any], points: ArrayLike, pixels: ArrayLike
) -> dict[str, Any]:
    """Errors of a calibration on pairs it may never have seen.

    intrinsics and transform: documents as in `solve_finish`. points (N, 3) metres, LiDAR frame; pixels (N, 2).
    Returns mean_px, rms_px, max_px and errors_px (N numbers) and forbidden (how many projections are none: behind
    the camera, or past the fold; each counts at least the image's diagonal). Raises GeometryError, SolveError.
    """
    model = parse_model(intrinsics.get("model"))
    marks = np.asarray(pixels, dtype=np.float64)
    if marks.ndim != 2 or marks.shape[1] != 2 or len(marks) == 0 or len(marks) != len(np.asarray(points)):
        raise SolveError("bad_shape", "There are no pairs to evaluate, or their numbers differ.", "")
    projected, violation = project(model, intrinsics, from_document(transform).apply(points))
    errors = distances_px(projected, violation, marks, image_diagonal_px(intrinsics["image_size"]))
    return {
        "mean_px": float(np.mean(errors)),
        "rms_px": float(np.sqrt(np.mean(errors * errors))),
        "max_px": float(np.max(errors)),
        "errors_px": errors.tolist(),
        "forbidden": int(np.count_nonzero(violation > 0.0)),
    }


def people_parameters(problem: FitProblem, p: Floats, transform: RigidTransform) -> dict[str, float]:
    """Parameters for reading: zyx angles and the turn from the nominal in degrees, metres, then the intrinsics."""
    angles = np.degrees(euler_from_rotation(transform.R))
    turn = np.degrees(vector_from_rotation(transform.R @ problem.nominal.R.T))
    named = dict(zip(("alpha_deg", "beta_deg", "gamma_deg"), angles.tolist(), strict=True))
    named |= dict(zip(("rotation_x_deg", "rotation_y_deg", "rotation_z_deg"), turn.tolist(), strict=True))
    named |= dict(zip(("t_x_m", "t_y_m", "t_z_m"), p[3:6].tolist(), strict=True))
    return named | dict(zip(INTRINSICS[problem.model], p[6:].tolist(), strict=True))


def intrinsics_document(problem: FitProblem, p: Floats) -> dict[str, Any]:
    """{"model", f_x, ..., "image_size": [width, height]} of a parameter vector."""
    return {
        "model": problem.model,
        **dict(zip(INTRINSICS[problem.model], p[6:].tolist(), strict=True)),
        "image_size": list(problem.image_size),
    }


def cpu_document() -> dict[str, str]:
    """The instruction set that the kernels were compiled for: across different ones the last bits can differ."""
    return {
        "target": os.environ.get("NUMBA_CPU_NAME") or _host_cpu_name(),
        "machine": platform.machine(),
        "system": platform.system(),
    }


def versions_document() -> dict[str, str]:
    """Versions of what computed the result."""
    return {"python": platform.python_version()} | {name: _version(name) for name in _LIBRARIES}


@cache
def _version(library: str) -> str:
    # Kept: it is read from the files of the package, which takes milliseconds.
    try:
        return version(library)
    except PackageNotFoundError:
        return "not installed"


def _status(state: State, found: Estimate, unexplained: list[str]) -> tuple[str, str]:
    problem, p, spread = found.fitted, found.parameters, found.spread
    if not is_determined(problem, p, spread):
        reasons = point_alarms(problem, p)
        return "not_determined", reasons[0] if reasons else (
            f"The pairs do not determine {', '.join(arbitrary(problem, spread))}: these values are arbitrary."
        )
    if state.stopped is None:
        return "unfinished", f"The schedule was stopped after {state.iteration} iterations; this is its best so far."
    if not found.outcome.converged:
        return "not_converged", f"The polish did not converge: {found.outcome.sentence}"
    if unexplained:
        return "not_explained", unexplained[0]
    reasons = {
        "converged": "no iteration brought a relative decrease above the tolerance any more",
        "goal": "the goal was reached",
        "iterations": "the number of iterations was reached",
    }
    return "ok", f"Stopped after {state.iteration} iterations: {reasons[state.stopped]}."


def _fit_document(problem: FitProblem, fit: Fit) -> dict[str, Any]:
    return {
        "mean_px": fit.mean_px,
        "rms_px": fit.rms_px,
        "minimised": fit.minimised,
        "converged": fit.outcome.converged,
        "message": fit.outcome.sentence,
        "parameters": _named(problem, fit.parameters),
    }


def _named(problem: FitProblem, parameters: Sequence[float]) -> dict[str, float]:
    return dict(zip(problem.names, (float(value) for value in parameters), strict=True))
