"""The checks of a result that need more than its own fit: held-out pairs, models, the rig, and what is current."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from apexcal.documents.checks import MARKS_CONFIRMED, Check, CheckTopic, CheckVerdict
from apexcal.documents.comparisons import ResultDifference
from apexcal.documents.pairs import CONFIRMED, MACHINE, MACHINE_OFF
from apexcal.documents.results import FitResult
from apexcal.documents.summaries import CameraSummary, RigSummary
from workers.judge.held_out_check import HeldOutPairs, held_out
from workers.judge.topics import HALF

_MODELS: Final = CheckTopic("models", "Other lens models")
_RUNS: Final = CheckTopic("runs", "Fits of the calibration")
_RIG: Final = CheckTopic("rig", "Other cameras of the rig")
_CURRENT: Final = CheckTopic("current", "Current result")
# Ratio of held-out errors from which a vehicle keeps what it has, and an error below which it never matters.
_WORSE: Final = 1.5
_FINE_PX: Final = 0.5
# Ratio of stated deviations that are clearly different: each is known to about a tenth (50 degrees of freedom).
_LESS_PRECISE: Final = 1.25
_LEAST_BLIND: Final = 2  # marks, for a standard error of their mean
_NO_COLUMNS: Final[Mapping[str, Sequence[Any]]] = MappingProxyType({})


@dataclass(frozen=True)
class CurrentResult:
    """The result that the vehicle gets now for the camera, or another published one.

    verdict: of its own checks; None if it was never judged. compared: the new result against it; None where one of
    them states no deviations. heldout_mean_px: its mean held-out error.
    """

    result: FitResult
    verdict: CheckVerdict | None
    compared: ResultDifference | None = None
    heldout_mean_px: float | None = None


def checks_of_calibration(
    result: FitResult,
    *,
    camera: str,
    summary: CameraSummary,
    ended_well: bool,
    pairs: HeldOutPairs | None = None,
    rig: RigSummary | None = None,
    current: CurrentResult | None = None,
    columns: Mapping[str, Sequence[Any]] = _NO_COLUMNS,
    confirming: CurrentResult | None = None,
) -> list[Check]:
    """Return what a calibration's end adds to the checks of a result, a fit to all pairs of a camera.

    ended_well: whether all runs are done; pairs: the held-out ones; rig: the comparison of the cameras; current: None
    where the vehicle has none, or it was withdrawn. columns: of its pairs, as `confirmed` reads them;
    confirming: the newest result that was given to the camera, passes, and stands on people's marks.
    """
    own = summary.models[result.model]
    return [
        confirmed(result, columns, confirming),
        held_out(result, own, pairs, columns),
        models(result.model, summary),
        runs(ended_well),
        of_rig(camera, rig if result.model == summary.recommended else None),
        beside_current(result, own.heldout_mean_px, current),
    ]


def confirmed(result: FitResult, columns: Mapping[str, Sequence[Any]], earlier: CurrentResult | None) -> Check:
    """Whether people looked at the marks, or an earlier result from people's marks agrees with this one.

    columns: `machine`, whether each pair stands on the machine's mark alone, `confirmed`, how many people accepted it
    after they saw it, and `machine_off_px`, the machine's mark minus blind ones (u, v), px; each may be missing.
    """
    machine = columns.get(MACHINE, ())
    by_people = sum(count > 0 for count in columns.get(CONFIRMED, ()))
    count = sum(machine) - by_people
    bias = _bias([off for off in columns.get(MACHINE_OFF, ()) if off is not None])
    figures: dict[str, float | None] = {"machine": float(count), "confirmed": float(by_people)}
    if not count:
        people = f"People confirmed {by_people} of {len(machine)} marks, which are the machine's."
        return MARKS_CONFIRMED.passes(
            (people if by_people else "No pair has the machine's mark alone.") + bias, **figures
        )
    nobody = f"Nobody looked at {count} of {len(machine)} marks, which are the machine's"
    apart = earlier.compared if earlier and _is_alike(result, earlier.result) else None
    if apart is None:
        verdict: CheckVerdict = "look"
        sentence = f"{nobody}, and no earlier result of this camera and lens from people's marks confirms them."
    else:
        verdict = "look" if apart.differs else "pass"
        differs = "differs from" if apart.differs else "agrees with"
        sentence = (
            f"{nobody}. The mount {differs} the earlier result from people's marks: {apart.rotation_deg:.2f} degrees "
            f"and {apart.translation_mm:.0f} mm apart, {apart.sigmas:.1f} times their stated errors."
        )
    return MARKS_CONFIRMED.fails(
        verdict,
        sentence + bias,
        "Confirm these marks on the recording's page (Confirm marks) and make the pairs again.",
        **figures,
        sigmas=apart and apart.sigmas,
    )


def _bias(offsets: Sequence[Sequence[float]]) -> str:
    """Say how far the machine's marks are off: the mean of their differences (u, v) from blind marks, px."""
    if len(offsets) < _LEAST_BLIND:
        return ""
    values = np.asarray(offsets, np.float64)
    (u, v), (du, dv) = values.mean(axis=0), values.std(axis=0, ddof=1) / np.sqrt(len(values))
    return (
        f" The machine's marks are off by {u:+.2f} ± {du:.2f} px in u and {v:+.2f} ± {dv:.2f} px in v on average: "
        f"people marked {len(values)} corners blind."
    )


def models(name: str, summary: CameraSummary) -> Check:
    """Whether another model is recommended. It stops a result that held-out pairs speak against."""
    recommended, behind = summary.recommended, summary.models[name].behind
    remedy = "Publish the recommended model."
    if not recommended:
        retry = "Retry the runs that failed, or calibrate without the models that the pairs do not determine."
        return _MODELS.fails("look", f"No model is recommended. {summary.why}", retry)
    if recommended == name:
        if len(summary.models) == 1:
            return _MODELS.not_checked(f"Only {name} was fitted.", "Calibrate with other models as well.")
        return _MODELS.passes(f"{name} is recommended; {len(summary.models)} were fitted.")
    clear = behind is not None and not behind.within_noise
    return _MODELS.fails(
        "stop" if clear else "look",
        f"{recommended} is recommended, not {name}. {summary.why}",
        remedy,
        behind_log_likelihood=behind and behind.log_likelihood,
    )


def runs(ended_well: bool) -> Check:
    """Whether every fit of the calibration ended."""
    return _RUNS.fails(
        "pass" if ended_well else "look",
        "Every fit of the calibration ended." if ended_well else "Not every fit of the calibration ended well.",
        "Retry the runs that failed.",
    )


def of_rig(camera: str, rig: RigSummary | None) -> Check:
    """Whether the rig's other cameras and what the rig states agree with this camera's mount."""
    if not rig:
        return _RIG.not_checked(
            "The calibration has no other camera to compare with.", "Calibrate the rig's cameras together."
        )
    if rig.problem:
        return _RIG.fails("look", f"The cameras could not be compared: {rig.problem.detail}", "Calibrate again.")
    against = [alarm for pair in rig.pairs if camera in pair.cameras for alarm in pair.alarms]
    return _RIG.fails(
        "stop" if against else "pass",
        " ".join(against) or "The cameras of the rig agree with each other and with what the rig states.",
        "Check the marks and clocks of these cameras, and what the rig states.",
    )


def beside_current(result: FitResult, heldout_px: float | None, current: CurrentResult | None) -> Check:
    """Whether a person should look before this result takes the current one's place.

    Results are compared if lens and model are alike. A current result that should not be used protects nothing.
    """
    if current is None:
        return _CURRENT.not_checked("The vehicle has no current calibration of this camera.", "Publish a result.")
    if current.verdict not in ("pass", "look"):
        return _CURRENT.not_checked(
            "The vehicle's current calibration fails its own checks.",
            "Publish a result that passes its checks.",
        )
    doubts: list[str] = []
    apart = current.compared if _is_alike(result, current.result) and current.verdict == "pass" else None
    figures: dict[str, float | None] = {}
    if apart:
        figures = {name: getattr(apart, name) for name in ("rotation_deg", "translation_mm", "sigmas")}
        if apart.differs:
            doubts.append(
                "Something moved, or a stated error is too small. The mount differs from the vehicle's current "
                f"calibration by {apart.rotation_deg:.2f} degrees and {apart.translation_mm:.0f} mm, "
                f"{apart.sigmas:.1f} times their stated errors."
            )
    own, other = (_over_limit(of) for of in (result.checks, current.result.checks))
    if own is not None and other is not None and own >= HALF and own > _LESS_PRECISE * other:
        figures["times_less_precise"] = own / other if other > 0.0 else None
        doubts.append(f"This result is {own / other:.1f} times as uncertain as the vehicle's current one.")
    worse = current.heldout_mean_px
    if heldout_px is not None and worse is not None and heldout_px > max(_WORSE * worse, _FINE_PX):
        doubts.append(
            f"Held-out pairs lie {heldout_px:.2f} px off, in the vehicle's current calibration {worse:.2f}."
        )
    return _CURRENT.fails(
        "look" if doubts else "pass",
        " ".join(doubts) or "Nothing speaks for keeping the vehicle's current calibration.",
        "Compare both results, and publish this one by hand if it is the better one.",
        **figures,
    )


def _is_alike(result: FitResult, other: FitResult) -> bool:
    """Whether their lenses are of one model and one origin, so that their mounts can be compared."""
    return (result.model, result.lens) == (other.model, other.lens)


def _over_limit(checks: Sequence[Check]) -> float | None:
    """Stated precision where the result is used, over its limit."""
    return next((check.figures.get("over_limit") for check in checks if check.name == "precision"), None)
