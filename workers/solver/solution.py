# pyright: reportMissingTypeStubs=false
"""The end of a run: polish, baselines, uncertainty and plain words, as one result.

It also says where the fit ended: on its bounds, far from its pairs, or beside another optimum.
"""

import os
import platform
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any, Final, NamedTuple

import numpy as np
from llvmlite import binding
from numpy.typing import ArrayLike, NDArray

from apexcal.documents.results import FitResult, FittedPairs, Intrinsics, LeastSquares, Search, Status
from apexcal.documents.transforms import SolvedTransform
from apexcal.geometry.rotations import euler_from_rotation, vector_from_rotation
from apexcal.geometry.se3 import SE3, from_document, to_document
from workers.geometry.models import INTRINSICS, parse_model
from workers.geometry.projection import distances_px, image_diagonal_px, project
from workers.solver.baselines import baseline, linear_baseline
from workers.solver.degeneracy import arbitrary, is_determined, point_problem
from workers.solver.estimate import Estimate, at_clock, estimate
from workers.solver.field import field
from workers.solver.halves import halves_of
from workers.solver.narrowing import SearchState
from workers.solver.next_steps import next_steps
from workers.solver.optima import MOST_SLOTS, optimum_sentences, other_optima
from workers.solver.outcomes import SolveError
from workers.solver.pair_errors import explained_px, marks_outside
from workers.solver.polish import Fit, cost_of, distances, mean_and_rms, polish, refine
from workers.solver.prediction import prediction
from workers.solver.problem import FitProblem
from workers.solver.residuals import transform_of
from workers.solver.rolling_shutter import rolling_shutter
from workers.solver.stated_lens import lens_origin, under_stated_lens
from workers.solver.uncertainty import Uncertainty
from workers.solver.weighting import whitened

Floats = NDArray[np.float64]
# llvmlite publishes no types.
_host_cpu_name: Callable[[], str] = binding.get_host_cpu_name
_LIBRARIES: Final = ("apexcal", "numpy", "scipy", "numba", "llvmlite")
_LOSS_WORDS: Final = {"mean": "mean pixel distance", "saturating": "saturating mean pixel distance"}


class Finished(NamedTuple):
    """The end of a fit: its estimate, and the result that it becomes."""

    estimate: Estimate
    result: FitResult


def finished(problem: FitProblem, state: SearchState) -> Finished:
    """Polish the search's best, and return all that the pairs tell; without checks and held-out errors.

    Raises SolveError `bad_schedule` where no iteration was done.
    """
    if not state.best_parameters:
        raise SolveError("bad_schedule", "The run has no iteration to finish from.", "Run at least one.")
    # Slots that are to agree are polished.
    descend = refine if problem.schedule.agreeing else polish
    best = estimate(problem, np.array(state.best_parameters), descend)
    problem = at_clock(problem, best.clock)
    polished, outliers, counted, spread = best.fit, best.outliers, best.fitted, best.spread
    p = best.parameters
    is_whole = problem.fold < 0
    halves = halves_of(best) if is_whole else []
    # Nothing reads the baselines and other optima of a fit that holds pairs out.
    plain: dict[str, Fit | None] = {}
    if is_whole:
        plain = {"baseline": baseline(counted), "linear_baseline": linear_baseline(counted)}
    compared = _compared(whitened(counted, p), polished, plain)
    transform = transform_of(problem, p)
    status, message = _status(state, best, misfit(problem, p))
    ga_mean, ga_rms = mean_and_rms(problem, state.best_parameters)
    stages = {name: None if fit is None else _least_squares(problem, fit) for name, fit in plain.items()}
    lens = lens_of(problem, p)
    precision = spread.fit_precision()
    result = FitResult(
        **dict(precision),
        model=problem.model,
        search=problem.search,
        status=status,
        message=message,
        loss=problem.loss,
        weights="equal" if problem.covariances is None else "covariances",
        pairs=int(np.count_nonzero(problem.weights)),
        free_parameters=len(problem.free),
        iterations=state.iteration,
        stopped=state.stopped,
        evaluations=state.evaluations,
        history=list(state.history),
        ga=Search(
            mean_px=ga_mean,
            rms_px=ga_rms,
            minimised=_LOSS_WORDS[problem.loss],
            loss_px=state.best_loss,
            parameters=_named(problem, state.best_parameters),
        ),
        polished=_least_squares(problem, polished),
        baseline=stages.get("baseline"),
        linear_baseline=stages.get("linear_baseline"),
        kept=_fitted_pairs(counted, p),
        outliers=outliers,
        parameters=people_parameters(problem, p, transform),
        intrinsics=lens,
        transform=SolvedTransform.model_validate(to_document(transform)),
        lens=lens_origin(problem),
        stated_lens=under_stated_lens(problem, best) if is_whole else None,
        unused_lens=problem.unused_lens,
        residuals_px=distances(problem, p).tolist(),
        at_bounds=at_bounds(problem, p),
        checks=[],
        several_optima=several_optima(counted, state, polished, compared, spread) if is_whole else [],
        shared_errors=best.shared,
        common_errors=dict(problem.common_errors),
        person_bias=best.bias,
        clock_offset=best.clock,
        line_time_us=problem.line_time_us,
        rolling_shutter=rolling_shutter(best) if is_whole else None,
        weak_priors=dict(best.weak),
        halves=halves,
        prediction=prediction(best, halves) if is_whole else None,
        next_steps=next_steps(best) if is_whole else None,
        explained_px=explained_px(problem, lens, precision) if is_whole else None,
        marks_outside=marks_outside(problem) if is_whole else None,
        field=field(problem, p, np.array(precision.covariance.matrix)) if is_whole else None,
        heldout=None,
        cpu=cpu_document(),
        versions=versions_document(),
        provenance=None,
        finish_seconds=None,
    )
    return Finished(best, result)


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


def _fitted_pairs(problem: FitProblem, p: Floats) -> FittedPairs:
    mean, rms = mean_and_rms(problem, p)
    return FittedPairs(pairs=int(np.count_nonzero(problem.weights)), mean_px=mean, rms_px=rms)


def evaluate(
    intrinsics: Mapping[str, Any], transform: Mapping[str, Any], points: ArrayLike, pixels: ArrayLike
) -> dict[str, Any]:
    """Errors of a calibration on pairs it may never have seen.

    intrinsics and transform: documents as in `finished`. points (N, 3) metres, LiDAR frame; pixels (N, 2).
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


def people_parameters(problem: FitProblem, p: Floats, transform: SE3) -> dict[str, float]:
    """Parameters for reading: zyx angles and the turn from the nominal in degrees, metres, then the intrinsics."""
    angles = np.degrees(euler_from_rotation(transform.R))
    turn = np.degrees(vector_from_rotation(transform.R @ problem.nominal.R.T))
    named = dict(zip(("alpha_deg", "beta_deg", "gamma_deg"), angles.tolist(), strict=True))
    named |= dict(zip(("rotation_x_deg", "rotation_y_deg", "rotation_z_deg"), turn.tolist(), strict=True))
    named |= dict(zip(("t_x_m", "t_y_m", "t_z_m"), p[3:6].tolist(), strict=True))
    return named | dict(zip(INTRINSICS[problem.model], p[6:].tolist(), strict=True))


def lens_of(problem: FitProblem, p: Floats) -> Intrinsics:
    """The lens of a parameter vector (D,)."""
    values: dict[str, Any] = dict(zip(INTRINSICS[problem.model], p[6:].tolist(), strict=True))
    return Intrinsics(model=problem.model, image_size=list(problem.image_size), **values)


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


def _status(state: SearchState, best: Estimate, unexplained: str | None) -> tuple[Status, str]:
    problem, p, spread = best.fitted, best.parameters, best.spread
    if not is_determined(problem, p, spread):
        return "not_determined", point_problem(problem, p) or (
            f"The pairs do not determine {', '.join(arbitrary(problem, spread))}: these values are arbitrary."
        )
    if state.stopped is None:
        return "unfinished", f"The search was stopped after {state.iteration} iterations; this is its best so far."
    if not best.outcome.converged:
        return "not_converged", f"The polish did not converge: {best.outcome.sentence}"
    if unexplained:
        return "not_explained", unexplained
    reasons = {
        "agreed": f"{problem.schedule.agreeing} searches found the same result",
        "converged": "The search improves no more",
        "goal": "The search reached its goal",
        "iterations": "The search ended at its limit of iterations",
    }
    return "ok", f"{reasons[state.stopped]} ({state.iteration} iteration{'' if state.iteration == 1 else 's'})."


def _least_squares(problem: FitProblem, fit: Fit) -> LeastSquares:
    return LeastSquares(
        mean_px=fit.mean_px,
        rms_px=fit.rms_px,
        minimised=fit.minimised,
        converged=fit.outcome.converged,
        message=fit.outcome.sentence,
        parameters=_named(problem, fit.parameters),
    )


def _named(problem: FitProblem, parameters: Sequence[float]) -> dict[str, float]:
    return dict(zip(problem.names, (float(value) for value in parameters), strict=True))


_BASELINE_BETTER: Final = 1e-3
_EXACT_PX: Final = 1e-4
# Share of the image's diagonal: no marking, and no lens model that is roughly right, leaves half of the pairs there.
_UNEXPLAINED: Final = 0.015


def at_bounds(problem: FitProblem, p: NDArray[np.float64]) -> list[str]:
    """Names of the free parameters that lie on an end of their bounds (within a millionth of the width)."""
    lower, upper = problem.lower, problem.upper
    margin = 1e-6 * (upper - lower)
    free = [i for i in problem.free.tolist() if i > 2 or not problem.any_rotation]
    return [problem.names[i] for i in free if p[i] <= lower[i] + margin[i] or p[i] >= upper[i] - margin[i]]


def misfit(problem: FitProblem, p: NDArray[np.float64]) -> str | None:
    """A sentence where half of the pairs lie further off than any marking explains: then it is no calibration."""
    middle = float(np.median(distances(problem, p)[problem.weights > 0.0]))
    if middle <= _UNEXPLAINED * problem.diagonal_px:
        return None
    return f"Half of the pairs lie more than {middle:.0f} px from where this calibration puts them."


def several_optima(
    problem: FitProblem, state: SearchState, polished: Fit, plain: dict[str, tuple[Fit, float]], spread: Uncertainty
) -> list[str]:
    """Sentences where slots, or search and baselines, ended in different places: there may be another optimum.

    plain: each baseline with its cost relative to the polished one's, by the words that name it.
    """
    sentences: list[str] = []
    if is_determined(problem, np.array(polished.parameters), spread):
        starts, ends = state.first_slot_parameters[:MOST_SLOTS], [fit for fit, _ in plain.values()]
        sentences += optimum_sentences(problem, polished, other_optima(problem, polished, starts, ends))
    for words, (fit, relative_cost) in plain.items():
        if relative_cost < 1.0 - _BASELINE_BETTER and fit.rms_px < polished.rms_px - _EXACT_PX:
            sentences.append(
                f"{words} ends lower ({fit.rms_px:.3f} px RMS) than the search and its polish "
                f"({polished.rms_px:.3f} px)."
            )
    return sentences
