"""Estimates how far the camera's clock is ahead of the LiDAR's, from the moving board.

The offset is one more unknown of the least squares over the camera's parameters (see `offset_fit`). Each mark counts
by its own noise and by the track's covariance as the image sees it; marks far from everything else are left out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from apexcal.documents.errors import InputError
from apexcal.documents.fit_requests import FitRequest
from workers.solver.narrowing import run_search
from workers.solver.offset_fit import Marks, TipTrack, fit_offset, marks_under, scores, weak_priors, whitening
from workers.solver.outcomes import NEVER, Outcome, Stop
from workers.solver.polish import distances, polish
from workers.solver.problem import FitProblem, fit_problem

Floats = NDArray[np.float64]

SEARCH_NS: Final = 150_000_000
MAX_SIGMA_NS: Final = 10_000_000
_STARTS_S: Final = 0.075  # fits start from offsets this far apart
_FARTHEST_S: Final = 0.3  # a mark whose moment lies farther than this from any vertex tells nothing
_LOST: Final = 0.01  # share of the image's diagonal: marks farther off than this are no fit yet
_BLUNDER: Final = 4.0  # standard deviations; one in 3000 good marks goes with them
_ROUNDS: Final = 6
_SETTLED_S: Final = 2e-5
_POOR: Final = 5.0  # times the expected residuals: then no camera fits


@dataclass(frozen=True)
class OffsetEstimate:
    """The camera's clock minus the LiDAR's, as `pairing.offset_ns` wants it.

    Attributes:
        offset_ns, sigma_ns: the estimate and its standard deviation.
        rms_px: root mean square distance of the marks that were kept.
        pairs: how many marks were used.
        blunders: how many marks were left out because they lie far from everything else.
        unseen: how many were left out because no vertex is near their moment.
        speed_px_s: how fast the apex moved in the image, root mean square over the marks.
        message: the result in one sentence.
    """

    offset_ns: int
    sigma_ns: int
    rms_px: float
    pairs: int
    blunders: int
    unseen: int
    speed_px_s: float
    message: str


def estimate_offset(
    track: TipTrack,
    frame_stamps_ns: ArrayLike,
    pixels: ArrayLike,
    request: FitRequest,
    *,
    about_ns: int = 0,
    search_ns: int = SEARCH_NS,
    max_sigma_ns: int = MAX_SIGMA_NS,
    stop: Stop = NEVER,
) -> OffsetEstimate:
    """Estimate the offset together with the camera.

    Args:
        track: the apex over time, LiDAR clock; `workers.vertices.tracks.Track` is one.
        frame_stamps_ns: (N,) stamps of the marked frames, camera clock.
        pixels: (N, 2) the marks.
        request: the camera and its stated facts; here the loss is the saturating one, whatever the request says.
        about_ns, search_ns: offsets within about_ns +- search_ns are looked for.
        max_sigma_ns: an estimate that is less certain than this is refused.
        stop: who may end it.

    Raises:
        InputError: ``offset_not_determined``, the motion or the marks do not tell it.
        SolveError: the request or the number of marks cannot be worked on.
    """
    stamps = np.asarray(frame_stamps_ns, np.int64).reshape(-1)
    marked = np.asarray(pixels, np.float64).reshape(-1, 2)
    marks = Marks.of(track, stamps, marked, about_ns, search_ns)
    problem = fit_problem(request.model_copy(update={"loss": "saturating"}), marks.points(0.0)[0], marked)
    problem = replace(problem, stop=stop)
    x, outcome = _start(problem, marks), Outcome.OUT_OF_STEPS
    on_track = np.zeros(len(stamps), np.bool_)
    counted = np.ones(len(stamps), np.bool_)
    for _ in range(_ROUNDS):
        before = x[-1]
        on_track = marks.gap_s[marks.nearest(float(x[-1]))] <= _FARTHEST_S
        _enough(problem, on_track)
        away = scores(problem, marks, x)
        # The median of the length of two unit Gaussians is 1.18.
        counted = on_track & (away < _BLUNDER * max(1.0, float(np.median(away[on_track])) / 1.18))
        x, outcome = fit_offset(problem, marks, x, counted, robust=False)
        if abs(x[-1] - before) < _SETTLED_S:
            break
    here = marks_under(problem, marks, x)
    sigma_s, poor = _deviation(problem, marks, x, counted)
    estimate = OffsetEstimate(
        offset_ns=about_ns + round(float(x[-1]) * 1e9),
        sigma_ns=round(sigma_s * 1e9),
        rms_px=_rms(np.linalg.norm(here.residuals[counted], axis=1)),
        pairs=int(counted.sum()),
        blunders=int((on_track & ~counted).sum()),
        unseen=int((~on_track).sum()),
        speed_px_s=_rms(here.speed_px_s()[counted]),
        message="",
    )
    _refuse(estimate, outcome, poor, abs(float(x[-1])) > search_ns * 1e-9 - 1e-3, max_sigma_ns)
    return _told(estimate)


def _start(problem: FitProblem, marks: Marks) -> Floats:
    """Camera and offset (D,) to go on from: the best of robust fits from offsets all over the search."""
    everything = np.ones(len(marks.pixels), np.bool_)
    # Plain least squares first: from the middle of the bounds nothing tells a blunder from a good mark.
    middle = np.append(0.5 * (problem.lower + problem.upper), 0.0)
    camera = fit_offset(problem, marks, middle, everything, robust=False).x[:-1]
    if float(np.median(distances(problem, camera))) > _LOST * problem.diagonal_px:
        state = run_search(problem)
        searched = np.array(polish(problem, state.best_parameters).parameters)
        camera = min(camera, searched, key=lambda p: float(np.median(distances(problem, p))))
    half = float(marks.offsets_s[-1])
    starts = np.linspace(-half, half, 2 * max(1, round(half / _STARTS_S)) + 1)
    fits = [fit_offset(problem, marks, np.append(camera, start), everything, robust=True).x for start in starts]
    return min(fits, key=lambda x: _unlikely(problem, marks, x))


def _unlikely(problem: FitProblem, marks: Marks, x: Floats) -> float:
    """Negative logarithm of the marks' likelihood under Cauchy's distribution, but for a constant."""
    W = whitening(problem, marks, marks_under(problem, marks, x), float(x[-1]))
    # Far from the vertices the track is vague; without the determinants vague would look good.
    return float(np.sum(np.log1p(scores(problem, marks, x) ** 2) - np.log(np.linalg.det(W))))


def _deviation(problem: FitProblem, marks: Marks, x: Floats, counted: NDArray[np.bool_]) -> tuple[float, float]:
    """The offset's standard deviation in seconds, and the residuals in units of what was expected."""
    here = marks_under(problem, marks, x)
    free = np.append(problem.free, len(x) - 1)
    white = (whitening(problem, marks, here, float(x[-1])) @ here.jacobian)[counted][:, :, free]
    rows = white.reshape(-1, len(free))
    _, strength = weak_priors(problem)
    A = rows.T @ rows + np.diag(np.append(strength[problem.free] ** 2, 0.0))
    # Columns of unit length, because focal lengths and seconds differ by powers of ten.
    size = np.sqrt(np.maximum(np.diag(A), 1e-300))
    C = np.linalg.pinv(A / size / size[:, None], hermitian=True) / size / size[:, None]
    count = max(1, 2 * int(counted.sum()) - len(free))
    poor = float(np.sqrt(np.sum(scores(problem, marks, x)[counted] ** 2) / count))
    return float(np.sqrt(C[-1, -1])) * max(1.0, poor), poor


def _enough(problem: FitProblem, on_track: NDArray[np.bool_]) -> None:
    unknowns, count = len(problem.free) + 1, int(on_track.sum())
    if 2 * count < unknowns + 4:
        raise InputError(
            "offset_not_determined",
            f"Only {count} marks lie near a corner of the track, for {unknowns} unknowns of camera and clock.",
            "Mark more frames, use a detector that finds more corners, or lock intrinsics that are known.",
        )


def _refuse(estimate: OffsetEstimate, outcome: Outcome, poor: float, at_end: bool, max_sigma_ns: int) -> None:
    offset_ms, sigma_ms = estimate.offset_ns * 1e-6, estimate.sigma_ns * 1e-6
    if poor > _POOR:
        raise InputError(
            "offset_not_determined",
            f"No camera and clock offset fits the marks: the best one is {estimate.rms_px:.0f} px off (RMS).",
            "Check that the marks show the board's top corner, and the camera's model and nominal mount.",
        )
    if estimate.sigma_ns > max_sigma_ns:
        raise InputError(
            "offset_not_determined",
            f"The clock offset is too uncertain: ±{sigma_ms:.0f} ms (limit {max_sigma_ns * 1e-6:.0f}, one standard "
            f"deviation). The corner moved by {estimate.speed_px_s:.0f} px/s in {estimate.pairs} marks.",
            "Walk across the view, to both sides, for a minute or more; mark more frames of it.",
        )
    if at_end:
        raise InputError(
            "offset_not_determined",
            f"The best offset, {offset_ms:.0f} ms, lies at the end of the searched range.",
            "Say about how far the clocks are apart (about_ns), or search farther.",
        )
    if not outcome.converged:
        raise InputError(
            "offset_not_determined",
            f"The fit of camera and clock did not converge: {outcome.sentence}",
            "Mark more frames, check the marks, and lock or bound what is known of camera and mount.",
        )


def _told(estimate: OffsetEstimate) -> OffsetEstimate:
    offset_ms, sigma_ms = estimate.offset_ns * 1e-6, estimate.sigma_ns * 1e-6
    way = "ahead of" if offset_ms >= 0 else "behind"
    message = (
        f"The camera's clock is {abs(offset_ms):.1f} ms {way} the LiDAR's, with a standard deviation of "
        f"{sigma_ms:.1f} ms, from {estimate.pairs} marks."
    )
    return replace(estimate, message=message)


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values * values)))
