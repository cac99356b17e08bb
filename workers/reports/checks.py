"""Checks of a result, each with a verdict of its own: what could be wrong, whether it is, and how large.

A check fails only if chance explains it in fewer than one of thousand sound results, and if it matters: if what it
finds is larger than half of a mark's noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from workers.reports.coverage import coverage_check
from workers.reports.further_unknowns import tested
from workers.reports.material import Material
from workers.reports.pair_errors import PairErrors
from workers.solver.estimate import Estimate
from workers.solver.residuals import by_point, predict

Floats = NDArray[np.float64]
Verdict = Literal["passed", "failed", "unknown"]
_CHANCE: Final = 1e-3
# Two-sided quantile of the normal distribution at one in a thousand.
_CERTAIN: Final = 3.29
# Twice the log likelihood ratio that independent errors exceed in one of a thousand cases, by the number of
# components. Each component is zero half of the time (Self and Liang 1987).
_TOGETHER: Final = {1: 9.55, 2: 11.76}
_MATTERS: Final = 0.5  # of the noise of a mark per coordinate
# Radial patterns up to the seventh power of the distance from the centre: the lens models' own terms go that far.
_POWERS: Final = (1, 2, 3, 4, 5, 6, 7)
# Share of wrong pairs from which marks, frames or pairing need a look as a whole; slips of the hand are about 1 %.
_MANY_WRONG: Final = 0.02
_FEWEST_WRONG: Final = 2


@dataclass(frozen=True)
class Check:
    """What was looked at, whether it passed, and a sentence; ``figures`` are what the sentence says, as numbers.

    ``forbids``: whether the result should not be used where the check fails; otherwise somebody should look first.
    """

    name: str
    title: str
    verdict: Verdict
    sentence: str
    figures: dict[str, Any] = field(default_factory=dict[str, Any])
    forbids: bool = True


def checks(material: Material, found: Estimate, errors: PairErrors) -> list[Check]:
    """All checks of the reported result. ``found``: its estimate without outliers; ``errors``: its pairs' errors."""
    document = material.chosen.document
    clocks = clock(found)
    return [
        off_axis(found, errors),
        clocks,
        rolling_shutter(document, found, clocks),
        wrong_pairs(document),
        together(document),
        halves(document),
        Check(*coverage_check(material, errors), forbids=False),
        stated_lens(document),
        elsewhere(material.elsewhere),
    ]


def off_axis(found: Estimate, errors: PairErrors) -> Check:
    """Whether errors grow with the angle to the camera's axis, as those of a lens model that does not fit do."""
    title = "Errors off the camera's axis"
    rings = rings_of(found, errors)
    figures: dict[str, Any] = {"rings": rings}
    if not rings:
        return Check("off_axis", title, "unknown", "Under the result the camera sees none of the points.", figures)
    told = " and ".join(
        f"{ring['rms_px']:.1f} px RMS {words} {ring[end]:.0f} degrees"
        for ring, words, end in ((rings[0], "within", "to_deg"), (rings[-1], "beyond", "from_deg"))
    )
    result = tested(found, _radial(found))
    if result is None:
        return Check("off_axis", title, "unknown", f"{told}; the result states no errors to compare with.", figures)
    used = found.holding.weights > 0.0
    size = np.hypot(*result.pattern[used].T)
    largest = float(np.quantile(size, 0.99))
    at = float(errors.angle_deg[used][int(np.argmin(np.abs(size - largest)))])
    figures |= {"probability": result.probability, "pattern_px": largest, "pattern_at_deg": at}
    if result.probability < _CHANCE and largest > _MATTERS * found.spread.sigma_px:
        return Check(
            "off_axis",
            title,
            "failed",
            f"The lens model {found.fitted.model} does not fit this lens: errors follow a radial pattern of up to "
            f"{largest:.1f} px, at {at:.0f} degrees from the axis. {told}. Compare the other models.",
            figures,
        )
    return Check("off_axis", title, "passed", f"Errors follow no radial pattern: {told}.", figures)


def rings_of(found: Estimate, errors: PairErrors, count: int = 4) -> list[dict[str, float]]:
    """Rings about the axis with equally many pairs: angles, number of pairs, RMS distance px. None without a pair."""
    used = (found.holding.weights > 0.0) & errors.seen
    if not np.any(used):
        return []
    angle, distance = errors.angle_deg[used], errors.distance_px[used]
    edges = np.quantile(angle, np.linspace(0.0, 1.0, count + 1))
    ring = np.clip(np.searchsorted(edges, angle, side="right") - 1, 0, count - 1)
    return [
        {
            "from_deg": float(edges[k]),
            "to_deg": float(edges[k + 1]),
            "pairs": int(np.count_nonzero(ring == k)),
            "rms_px": float(np.sqrt(np.mean(distance[ring == k] ** 2))),
        }
        for k in range(count)
        if np.any(ring == k)
    ]


def _radial(found: Estimate) -> Floats:
    """(N, 2, powers) shifts along the radius from the principal point, 1 px each at the image's corner."""
    problem = found.holding
    pixels, violation = predict(problem, found.held_at)
    away = np.where((violation > 0.0)[:, None], 0.0, pixels - found.held_at[8:10])
    radius = np.linalg.norm(away, axis=1)
    unit = away / np.maximum(radius, 1e-9)[:, None]
    share = radius / (0.5 * problem.diagonal_px)
    return unit[:, :, None] * np.stack([share**power for power in _POWERS], axis=1)[:, None, :]


def clock(found: Estimate) -> Check:
    """Whether the marks lie where the board was at another moment: the clocks' offset."""
    title = "Clocks of camera and LiDAR"
    problem = found.holding
    if problem.velocities is None:
        return Check("clock", title, "unknown", "The pairs do not say how the board moved.")
    moved = by_clock(found)
    result = tested(found, moved[:, :, None])
    if result is None or not np.isfinite(result.deviations[0]) or result.deviations[0] == 0.0:
        return Check(
            "clock", title, "unknown", "The board's motion does not distinguish it from an error of the mount."
        )
    value, deviation = float(result.values[0]), float(result.deviations[0])
    speed = _speed(found, moved)
    failed = abs(value) > _CERTAIN * deviation and abs(value) * speed > _MATTERS * found.spread.sigma_px
    offset = f"{1e3 * abs(value):.1f} ± {1e3 * deviation:.1f} ms"
    sentence = (
        f"The marks lie where the board was {offset} {'later' if value > 0 else 'earlier'} than the pairs say: the "
        "offset between the clocks is wrong. Estimate it, and detect again."
        if failed
        else f"The marks follow the board's motion: the clocks differ by {offset}."
    )
    figures = {"seconds": value, "deviation_seconds": deviation, "speed_px_s": speed}
    return Check("clock", title, "failed" if failed else "passed", sentence, figures)


def by_clock(found: Estimate) -> Floats:
    """(N, 2) how fast each pair's projection moves, px/s; zero where there is none."""
    problem = found.holding
    assert problem.velocities is not None
    _, violation = predict(problem, found.held_at)
    moved = np.einsum("nij,nj->ni", by_point(problem, found.held_at), problem.velocities)
    return np.where((violation > 0.0)[:, None], 0.0, moved)


def _speed(found: Estimate, moved: Floats) -> float:
    return float(np.median(np.hypot(*moved[found.holding.weights > 0.0].T)))


def rolling_shutter(document: dict[str, Any], found: Estimate, clocks: Check) -> Check:
    """Whether the result says that the camera reads its rows one after the other, which the solver tests.

    It forbids the use if marks at the image's upper and lower edge are off by more than half of their noise. If the
    clocks are off and explain the residuals better, the check says nothing of the rows.
    """
    title, shown = "Rolling shutter", document.get("rolling_shutter")
    if not shown:
        return Check("rolling_shutter", title, "unknown", "The result does not say how the rows are read.")
    line_us, std_us = shown["line_time_us"], shown["std_us"]
    line = f"{line_us:.0f} ± {std_us:.0f} microseconds a row"
    figures = {"line_time_us": line_us, "std_us": std_us, "limit": shown["limit"]}
    if not shown["shown"]:
        sentence = f"All rows of a frame show the same moment: {line}."
        return Check("rolling_shutter", title, "passed", sentence, figures)
    if clocks.verdict == "failed" and _deviations(clocks.figures, "seconds") >= abs(line_us) / max(std_us, 1e-9):
        sentence = f"The clocks' offset explains the residuals better than rows that are read in turn ({line})."
        return Check("rolling_shutter", title, "unknown", sentence, figures)
    begins = "Residuals along the board's motion grow"
    said = next((alarm for alarm in document.get("alarms", []) if alarm.startswith(begins)), None)
    sentence = said or f"The rows of a frame show different moments ({line}): a rolling shutter."
    matters = False
    if found.holding.velocities is not None:
        half_s = 0.5e-6 * abs(line_us) * found.holding.image_size[1]
        figures["speed_px_s"] = _speed(found, by_clock(found))
        matters = half_s * figures["speed_px_s"] > _MATTERS * found.spread.sigma_px
    return Check("rolling_shutter", title, "failed", sentence, figures, forbids=matters)


def _deviations(figures: dict[str, Any], name: str) -> float:
    return abs(figures[name]) / max(figures[f"deviation_{name}"], 1e-12)


def wrong_pairs(document: dict[str, Any]) -> Check:
    """Whether more pairs than slips of the hand explain do not belong."""
    outliers, pairs = document.get("outliers", []), document.get("pairs") or len(document.get("residuals_px") or [])
    excluded = sum(bool(one["excluded"]) for one in outliers)
    figures = {"outliers": len(outliers), "excluded": excluded, "pairs": pairs}
    many = len(outliers) > max(_MANY_WRONG * pairs, _FEWEST_WRONG)
    kept = "left out of the fit" if excluded else "in the fit"
    sentence = (
        f"{len(outliers)} of {pairs} pairs do not belong; they are {kept}."
        if outliers
        else f"None of the {pairs} pairs is an outlier."
    )
    verdict: Verdict = "failed" if many else "passed"
    return Check("wrong_pairs", "Wrong marks", verdict, sentence, figures, forbids=excluded == 0)


def together(document: dict[str, Any]) -> Check:
    """Whether pairs of one pose, or near in time, err together."""
    title, shared = "Errors that pairs share", document.get("shared_errors")
    if not shared:
        return Check("shared_errors", title, "unknown", "The pairs name no poses, or are too few to tell.")
    begins = tuple(
        f"{which} err together" for which in ("Pairs of one group", "Pairs near in time", "Groups near in time")
    )
    said = " ".join(alarm for alarm in document.get("alarms", []) if alarm.startswith(begins)) or None
    figures = {name: shared[name] for name in ("evidence", "widening", "deviations")}
    if said is None and shared["evidence"] > _TOGETHER.get(len(shared["deviations"]), np.inf):
        sizes = " and ".join(_size(*one) for one in shared["deviations"].items() if one[1] > 0.0)
        blocks = "group" if shared["by"] == "group" else "stretch of the walk"
        said = (
            f"Pairs of one {blocks} err together, by {sizes} from one to the next. The standard deviations count "
            f"that; they are {shared['widening']:.2f} times those of independent errors."
        )
    if said:
        # The stated deviations count them.
        return Check("shared_errors", title, "failed", said, figures, forbids=False)
    return Check("shared_errors", title, "passed", "Pairs of one pose, or near in time, err independently.", figures)


def _size(name: str, deviation: float) -> str:
    if name == "offset_m":
        return f"{1e3 * deviation:.2g} mm"
    return f"{deviation:.2g} {'px' if name == 'shift_px' else 'degrees'}"


def halves(document: dict[str, Any]) -> Check:
    """Whether fits of two halves of the pairs agree within what is stated."""
    title, said = "Halves of the pairs", document.get("stated_too_small") or []
    compared: Sequence[dict[str, Any]] = document.get("halves") or []
    figures = {one["split"]: one["ratio"] for one in compared}
    if said:
        return Check("halves", title, "failed", " ".join(said), figures)
    if not compared:
        return Check("halves", title, "unknown", "The pairs are too few for two fits.", figures)
    ratios = " and ".join(f"{one['ratio']:.2f}" for one in compared)
    sentence = f"Two fits of halves differ by {ratios} times the stated standard deviation; 1 is expected."
    return Check("halves", title, "passed", sentence, figures)


def stated_lens(document: dict[str, Any]) -> Check:
    """Whether the pairs bear out the lens that the recording or a file states, as the result says."""
    title, of = "Stated lens", document.get("stated_lens")
    if not of:
        return Check("stated_lens", title, "unknown", "Neither the recording nor a file states a lens.")
    verdict: Verdict = "unknown" if of["explains"] is None else "passed" if of["explains"] else "failed"
    figures = {name: of[name] for name in ("rms_px", "free_lens_rms_px")}
    sentence = f"{of['sentence']} The result's lens is {document['lens']}."
    return Check("stated_lens", title, verdict, sentence, figures, forbids=False)


def elsewhere(validations: Sequence[dict[str, Any]]) -> Check:
    """Whether validations on other data agree with the result."""
    title = "Other recordings"
    if not validations:
        return Check("elsewhere", title, "unknown", "No validation tested the result on other data.")
    verdicts = [one["verdict"] for one in validations]
    figures = {verdict: verdicts.count(verdict) for verdict in ("agrees", "disagrees", "unknown")}
    against = [one["sentence"] for one in validations if one["verdict"] == "disagrees"]
    if against:
        return Check("elsewhere", title, "failed", " ".join(against), figures)
    said = f"{figures['agrees']} of {len(verdicts)} validations on other data agree with the result"
    if figures["agrees"]:
        return Check("elsewhere", title, "passed", f"{said}, none disagrees.", figures)
    return Check("elsewhere", title, "unknown", "No validation on other data came to a verdict.", figures)
