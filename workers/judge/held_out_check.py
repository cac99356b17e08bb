"""The check of a fit on pairs that it held out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from apexcal.documents.checks import USE_LIMIT_PX, USE_LIMIT_RAD, Check, CheckTopic, CheckVerdict, figure
from apexcal.documents.results import FitResult
from apexcal.documents.summaries import ModelSummary
from apexcal.geometry.se3 import from_document
from workers.judge.pair_checks import UNEXPLAINED, unexplained_px
from workers.judge.topics import HALF, LOOK_RATE, STOP_RATE, more_corners
from workers.solver.prediction import DISTANCES_M

Floats = NDArray[np.float64]
_HELD_OUT: Final = CheckTopic("held_out", "Held-out pairs")
# Ratio of held-out to fitted error from which a fit says little about other places. Twenty real pairs for sixteen
# parameters give 3.3, enough pairs 1.1.
_FAR: Final = 3.0
# An error below this is no doubt, whatever it is compared with.
_FINE_PX: Final = 0.5
_FEWEST: Final = 10  # pairs of one distance that are judged together


class HeldOutPairs(NamedTuple):
    """Held-out pairs of all folds, (M,) each: distances from their marks in px of a typical pair's noise, by how much
    that whitening scales lengths, and distances from the camera, m.
    """

    standard_px: Floats
    stretch: Floats
    distances_m: Floats


def held_out_pairs(result: FitResult, folds: Sequence[FitResult], points: ArrayLike) -> HeldOutPairs | None:
    """Return the held-out pairs that belong; None if nothing was held out.

    result: the fit to all pairs; folds: of its model; points (N, 3): of all pairs, metres, the LiDAR's frame.
    """
    if not folds:
        return None
    far = np.linalg.norm(from_document(result.transform).apply(points), axis=1)
    errors, stretch = np.full(len(far), np.nan), np.ones(len(far))
    for heldout in (fold.heldout for fold in folds):
        if heldout:
            rows = np.asarray(heldout.indices, np.int64)
            errors[rows], stretch[rows] = heldout.standard_px, heldout.stretch
    errors[[outlier.index for outlier in result.outliers]] = np.nan
    judged = np.isfinite(errors)
    return HeldOutPairs(errors[judged], stretch[judged], far[judged])


def held_out(
    result: FitResult, summary: ModelSummary, pairs: HeldOutPairs | None, columns: Mapping[str, Sequence[Any]]
) -> Check:
    """Whether held-out pairs lie where the fit expects them, as well as its use needs.

    result: of the fit to all pairs; summary: of its model; columns: of its pairs. A point's own error is what the
    pairs about its distance show beyond the noise of the fit.
    """
    mean_px, fitted_px = summary.heldout_mean_px, result.kept.mean_px
    if mean_px is None:
        return _HELD_OUT.fails("look", "No pairs were held out.", "Calibrate with held-out blocks.")
    noise, explained = summary.heldout_sigma_px, result.explained_px
    doubts: list[str] = []
    if mean_px > max(_FAR * fitted_px, _FINE_PX):
        doubts.append("the pairs are too few, too uneven, or some of them wrong")
    unexplained = unexplained_px(noise, explained) if noise and explained else 0.0
    if noise and explained and noise > UNEXPLAINED * explained and unexplained > HALF * _limit_px(result):
        doubts.append(
            f"their noise is {figure(noise)} px per coordinate, and marks and corners explain {figure(explained)} px"
        )
    verdict: CheckVerdict = "look" if doubts else "pass"
    figures: dict[str, float | None] = {"mean_px": mean_px, "fitted_mean_px": fitted_px, "noise_px": noise}
    for distance, off_px, chance in _by_distance(result, pairs) if pairs else ():
        figures[f"beyond_noise_at_{distance:.0f}_m_px"] = off_px
        if chance < LOOK_RATE and off_px > _limit_px(result):
            verdict = "stop" if chance < STOP_RATE else "look" if verdict == "pass" else verdict
            doubts.append(
                f"about {distance:.0f} m away they lie {figure(off_px)} px off beyond the noise "
                f"(limit {figure(_limit_px(result))} px)"
            )
    sentence = f"Held-out pairs lie {mean_px:.2f} px off, the fitted ones {fitted_px:.2f}"
    return _HELD_OUT.fails(
        verdict,
        f"{sentence}: {'; '.join(doubts)}." if doubts else f"{sentence}.",
        f"{more_corners(columns)}, over more of the image; check the marks and the lens model.",
        **figures,
    )


def _limit_px(result: FitResult) -> float:
    lens = result.intrinsics
    return max(USE_LIMIT_PX, USE_LIMIT_RAD * float(np.sqrt(lens.f_x * lens.f_y)))


def _by_distance(result: FitResult, pairs: HeldOutPairs) -> list[tuple[float, float, float]]:
    """Return, for each distance with enough pairs, metres, RMS beyond the noise (px) and its probability by chance.

    The RMS is a typical point's: the squares of a noise of 1 px, halved, are exponential, and their median is ln 2,
    known to 1 / sqrt(M). So one block beyond all fitted pairs does not decide.
    """
    noise_px = result.sigma_px
    edges = np.sqrt(np.array(DISTANCES_M[:-1]) * np.array(DISTANCES_M[1:]))
    band = np.searchsorted(edges, pairs.distances_m)
    judged: list[tuple[float, float, float]] = []
    for k, distance in enumerate(DISTANCES_M):
        halves = 0.5 * (pairs.standard_px[band == k] / noise_px) ** 2
        if len(halves) < _FEWEST:
            continue
        median = float(np.median(halves))
        chance = float(special.ndtr(-(median - np.log(2.0)) * np.sqrt(len(halves))))
        beyond = 2.0 * noise_px**2 * max(median / np.log(2.0) - 1.0, 0.0)
        judged.append((distance, float(np.sqrt(beyond) / np.median(pairs.stretch[band == k])), chance))
    return judged
