"""Checks of the pairs: marks that do not belong, their number and places, what they cover, and their noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy import special

from apexcal.documents.checks import USE_LIMIT_PX, USE_LIMIT_RAD, Check, CheckTopic, CheckVerdict, figure
from apexcal.documents.pairs import MACHINE
from apexcal.documents.results import FitResult
from apexcal.geometry.rotations import vector_from_rotation
from workers.judge.topics import HALF, LOOK_RATE, STOP_RATE, more_corners, over_use
from workers.solver.estimate import Estimate
from workers.solver.pair_errors import explained_px, marks_outside, paired_apart_ms
from workers.solver.problem import FitProblem
from workers.solver.residuals import transform_of

Floats = NDArray[np.float64]
_WRONG: Final = CheckTopic("wrong_pairs", "Wrong marks")
_OUTSIDE: Final = CheckTopic("marks_outside", "Marks outside of the image")
_PAIRS: Final = CheckTopic("pairs", "Number of pairs and places")
_COVERAGE: Final = CheckTopic("coverage", "Coverage of the image")
_NOISE: Final = CheckTopic("noise", "Noise of the marks")
# Share of marks of a careful hand that slip (about 1 % in public data, 2 % in the worst of them).
_SLIPS: Final = 0.02
# Half of the share at which any fit may follow the wrong pairs (Hampel's breakdown point, one half).
_MOST_WRONG: Final = 0.25
# Degrees of freedom by which the noise is known to a tenth, 1 / (2 * 0.1^2) (JCGM 100:2008, equation E.7).
_LEAST_FREEDOM: Final = 50.0
# Places of the board farther apart than this are different ones: a board's corners lie within it.
_APART_M: Final = 1.5
# Places by which the error that one place shares is known to a third (the same equation: 1 / (2 (1/3)^2) = 4.5
# freedoms).
_LEAST_PLACES: Final = 6
_OF_MOUNT: Final = 6  # the first parameters; what is free behind them is the lens
# A stated error of three times the use limit is accepted over half of the image: road users are about the horizon,
# not in its upper and lower quarter.
_OF_USE: Final = 3.0
_MOST_OF_IMAGE: Final = 0.5
# Ratio of the residuals' noise to what marks and vertices explain: a person's marks are as good as stated to a third
# (`common_errors.STATED_FREEDOM`), so 1.5 is a deviation and a half above, and 3 is none of a person's.
UNEXPLAINED: Final = 1.5
_GROSS: Final = 3.0


def wrong_pairs(estimate: Estimate, result: FitResult) -> Check:
    """Whether more pairs than slips of the hand explain do not belong, and whether they are in the fit."""
    count = len(result.outliers)
    excluded = sum(outlier.excluded for outlier in result.outliers)
    pairs = int(np.count_nonzero(estimate.fitted.weights)) + excluded
    chance = float(special.bdtrc(count - 1, pairs, _SLIPS)) if count else 1.0
    verdict: CheckVerdict = "pass"
    if count > _MOST_WRONG * pairs or (count > excluded and chance < STOP_RATE):
        verdict = "stop"
    elif chance < LOOK_RATE or count > excluded:
        verdict = "look"
    where = "left out of the fit" if excluded else "in the fit" + _moved(estimate)
    return _WRONG.fails(
        verdict,
        f"{count} of {pairs} pairs do not belong; they are {where}."
        if count
        else f"All {pairs} pairs belong together.",
        "Are these marks wrong? Look at them, at the times of their frames and at the corner that was marked"
        + ("." if excluded else "; or leave them out (--outliers exclude), and compare held-out errors."),
        wrong=float(count),
        excluded=float(excluded),
        pairs=float(pairs),
        probability=chance,
    )


def _moved(estimate: Estimate) -> str:
    if estimate.kept is None:
        return ""
    to, begin = (transform_of(estimate.fitted, p) for p in (estimate.parameters, estimate.held_at))
    turn = float(np.degrees(np.linalg.norm(vector_from_rotation(to.R @ begin.R.T))))
    shift_mm = 1e3 * float(np.linalg.norm(to.t - begin.t))
    return f" and move the mount by {figure(turn)} degrees and {figure(shift_mm)} mm, which the stated errors include"


def outside(problem: FitProblem, pairs_of_set: Mapping[str, Sequence[Any]]) -> Check:
    """Whether people's marks that belong lie outside of the image, where nobody sees anything.

    The machine continues the board's edges, and states how well. ``pairs_of_set``: columns of the set, if at hand.
    """
    by_people = ~np.array(pairs_of_set.get(MACHINE) or np.zeros(len(problem.weights)), np.bool_)
    count, pairs = marks_outside(problem, by_people), int(np.count_nonzero(problem.weights[by_people]))
    return _OUTSIDE.fails(
        "stop" if count > _SLIPS * pairs else "look" if count else "pass",
        f"{count} of {pairs} people's marks lie outside of the image."
        if count
        else "People's marks lie inside the image.",
        "Check the image size, and the order and signs of u and v.",
        outside=float(count),
    )


def number_of_pairs(estimate: Estimate, pairs_of_set: Mapping[str, Sequence[Any]]) -> Check:
    """Whether pairs and places are enough to know their own errors. `pairs_of_set`: its columns, if at hand."""
    problem = estimate.holding
    used = problem.weights > 0.0
    freedom, places = estimate.spread.freedom or 0.0, places_of(problem.points[used])
    few = [] if freedom >= _LEAST_FREEDOM else [f"{freedom:.0f} degrees of freedom ({_LEAST_FREEDOM:.0f} are enough)"]
    few += [] if places >= _LEAST_PLACES else [f"{places} places {_APART_M:g} m apart ({_LEAST_PLACES} are enough)"]
    pairs = int(np.count_nonzero(used))
    # Two coordinates a mark. More marks loosen weak priors, until each parameter takes a whole degree.
    missing = int(np.ceil(0.5 * (_LEAST_FREEDOM + len(problem.free)))) - pairs
    more = more_corners(pairs_of_set, missing if freedom < _LEAST_FREEDOM else 0)
    lock = ", or lock what is known" if np.any(problem.free >= _OF_MOUNT) else ""
    return _PAIRS.fails(
        "look" if few else "pass",
        f"{pairs} pairs are too few to tell how large their errors are: {' and '.join(few)}."
        if few
        else f"{pairs} pairs are enough for {len(problem.free)} parameters: they tell how large their errors are.",
        f"{more}{', at more places' if places < _LEAST_PLACES else ''}{lock}.",
        pairs=float(pairs),
        degrees_of_freedom=freedom,
        places=float(places),
    )


def places_of(points: Floats) -> int:
    """Return how many of the points (N, 3), metres, lie apart from each other, up to the number that is enough."""
    left, count = points, 0
    while len(left) and count < _LEAST_PLACES:
        left = left[np.linalg.norm(left - left[0], axis=1) > _APART_M]
        count += 1
    return count


def coverage(problem: FitProblem, result: FitResult, pairs: Mapping[str, Sequence[Any]]) -> Check:
    """Whether most of the image is known well enough, by the errors that the result states over it.

    A board that is carried upright has few heights. Beyond the marks the stated errors hold as well
    (`docs/checks.md`), so that they, not the span of the marks, say what the result is good for.
    """
    u, v = problem.pixels[problem.weights > 0.0].T
    width, height = problem.image_size
    across, down = (
        float(np.subtract(*np.quantile(values, (0.975, 0.025)))) / size for values, size in ((u, width), (v, height))
    )
    half_widths = _over_image_px(result)
    span = f"The marks span {across:.0%} of the image's width and {down:.0%} of its height."
    if half_widths is None:
        return _COVERAGE.fails(
            "look", f"Nothing states the errors beyond the marks. {span}", f"{more_corners(pairs)}."
        )
    most_px, all_px = float(half_widths[int(_MOST_OF_IMAGE * len(half_widths))]), float(half_widths[-1])
    everywhere = f"{figure(all_px)} px over all of it" if np.isfinite(all_px) else "elsewhere it is not determined"
    lens = result.intrinsics
    limit_px = _OF_USE * max(USE_LIMIT_PX, USE_LIMIT_RAD * float(np.sqrt(lens.f_x * lens.f_y)))
    short = "width" if across < down else "height"
    return _COVERAGE.fails(
        "look" if most_px > limit_px else "pass",
        f"A point at 20 m is up to {figure(most_px)} px off over half of the image (limit {figure(limit_px)} px), "
        f"{everywhere} (95 %). {span}",
        f"Walk where the board reaches the image's edges, for more of its {short}"
        + ("; or state the lens." if result.lens == "fitted" else "."),
        width_share=across,
        height_share=down,
        half_of_image_px=most_px if np.isfinite(most_px) else None,
        image_px=all_px if np.isfinite(all_px) else None,
    )


def _over_image_px(result: FitResult) -> Floats | None:
    """Stated 95 % half-widths of points at 20 m over the image, px, ascending; infinite where the lens has no ray."""
    if result.prediction is None:
        return None
    at = result.prediction.distances_m.index(20.0)
    stated = [point.stated_px[at] if point.stated_px else np.inf for point in result.prediction.points]
    return 1.96 * result.prediction.expected_over_stated * np.sort(stated)


def noise(estimate: Estimate, result: FitResult, pairs: Mapping[str, Sequence[Any]]) -> Check:
    """Whether marks and vertices explain the residuals' noise. `pairs`: columns of the set, if at hand."""
    problem, sigma, freedom = estimate.holding, estimate.spread.sigma_px, estimate.spread.freedom
    explained = explained_px(problem, result.intrinsics, result)
    ratio = sigma / explained
    chance = float(special.chdtrc(freedom, freedom * ratio**2)) if freedom else 1.0
    verdict: CheckVerdict = "pass"
    # Good marks are not worse for a cause that nobody sees at points of use.
    lens = result.intrinsics
    rest = over_use(unexplained_px(sigma, explained), float(np.sqrt(lens.f_x * lens.f_y)))
    if chance < LOOK_RATE and ratio > UNEXPLAINED and rest > HALF:
        verdict = "stop" if ratio > _GROSS and chance < STOP_RATE and rest > 1.0 else "look"
    apart = paired_apart_ms(pairs)
    nearest = (
        f" Half of the corners were paired with a frame more than {apart:.0f} ms away and not moved to its time: "
        "detect again with pairing mode auto."
        if apart
        else ""
    )
    sentence = f"The residuals' noise is {figure(sigma)} px per coordinate"
    return _NOISE.fails(
        verdict,
        f"{sentence}, which marks and corners explain."
        if ratio <= UNEXPLAINED or chance >= LOOK_RATE
        else f"{sentence}; marks and corners explain {figure(explained)} px"
        f"{'; the rest is too small to matter' if verdict == 'pass' else ''}.",
        f"Check the marks, the times and the lens model: one of them is worse than stated.{nearest}",
        noise_px=sigma,
        explained_px=explained,
        probability=chance,
    )


def unexplained_px(noise_px: float, stated_px: float) -> float:
    """Noise per coordinate beyond what is stated of marks and vertices, px."""
    return float(np.sqrt(max(noise_px**2 - stated_px**2, 0.0)))
