"""Checks that take more than one fit: held-out pairs, other models, other cameras, and the current calibration."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from apexcal.documents.checks import Check, CheckVerdict
from workers.judge.topics import USE_LIMIT_PX, Topic

Summary = Mapping[str, Any]
_RUNS: Final = Topic("runs", "Fits of the calibration")
_MODELS: Final = Topic("models", "Camera models")
_HELD_OUT: Final = Topic("held_out", "Held-out pairs")
_CAMERAS: Final = Topic("cameras", "Other cameras of the rig")
_CURRENT: Final = Topic("current", "The vehicle's current calibration")
# Ratio of held-out to fitted error above which a fit says little about other places. Twenty real pairs for sixteen
# parameters give 3.3, enough pairs 1.1.
_FAR: Final = 3.0
# A held-out error below this is no doubt: half a pixel is better than a person marks.
_FINE_PX: Final = 0.5
# Ratio to the current result's held-out error above which the vehicle should keep the current one.
_WORSE: Final = 1.5
_MORE_PAIRS: Final = "Mark more vertices, at other places and distances, and look at the outliers."


def checks_of_calibration(
    camera: str, found: Summary, model: str, rig: Summary | None, *, ended_well: bool
) -> list[Check]:
    """Return the checks of a model's fit beside the other fits of its calibration.

    found: the camera's summary; rig: the comparison of the cameras, None for one camera; ended_well: whether every
    run is done.
    """
    return [
        _runs(ended_well=ended_well),
        _models(found, model),
        _held_out(found["models"][model]),
        _cameras(camera, found, model, rig),
    ]


def _runs(*, ended_well: bool) -> Check:
    return _RUNS.fails(
        "pass" if ended_well else "look",
        "Every fit of the calibration ended well." if ended_well else "Not every fit of the calibration ended well.",
        "Read why on the calibration's page, and calibrate again.",
    )


def _models(found: Summary, model: str) -> Check:
    recommended, behind = found["recommended"], found["models"][model].get("behind")
    if recommended == model:
        return _MODELS.passes(found["why"])
    if recommended is None:
        return _MODELS.fails("stop", f"No model is recommended. {found['why']}", _MORE_PAIRS)
    verdict: CheckVerdict = "look" if behind and behind["within_noise"] else "stop"
    return _MODELS.fails(
        verdict, f"{recommended} is recommended, not {model}. {found['why']}", f"Take the result of {recommended}."
    )


def _held_out(model: Summary) -> Check:
    held_out, fitted = model["heldout_mean_px"], model["polished"]["mean_px"]
    if held_out is None:
        return _HELD_OUT.fails(
            "look",
            "No pairs were held out to judge it by.",
            "Calibrate with --folds 5, or validate it on other data.",
        )
    is_far = held_out > max(_FAR * fitted, _FINE_PX)
    forbidden = model["heldout_forbidden"]
    lost = f"; {forbidden} of them have no projection" if forbidden else ""
    return _HELD_OUT.fails(
        "stop" if is_far else "pass",
        f"Held-out pairs lie {held_out:.2f} px off, the fitted ones {fitted:.2f} px{lost}.",
        _MORE_PAIRS,
        heldout_mean_px=held_out,
        fitted_mean_px=fitted,
    )


def _cameras(camera: str, found: Summary, model: str, rig: Summary | None) -> Check:
    if rig is None:
        return _CAMERAS.passes("The calibration has one camera.")
    if model != found["recommended"]:
        return _CAMERAS.passes("Cameras are compared by their recommended results.")
    if rig.get("problem"):
        return _CAMERAS.fails(
            "look",
            f"The cameras could not be compared: {rig['problem']['detail']}",
            rig["problem"].get("hint") or "Compare them by hand.",
        )
    alarms = [alarm for pair in rig["pairs"] if camera in pair["cameras"] for alarm in pair["alarms"]]
    return _CAMERAS.fails(
        "stop" if alarms else "pass",
        " ".join(alarms) or "The cameras agree with each other and with what the rig states.",
        "Check the rig, the marks of both cameras, and their checks.",
    )


def current(
    apart: Summary | None, heldout_px: float | None, current_px: float | None, is_current_unsound: bool
) -> Check:
    """Return the check of a result beside the camera's current one.

    apart: how far they are from each other (`ResultDistance`), None where one states no deviations; the held-out
    errors of both. A current result that fails its own checks (is_current_unsound) protects nothing.
    """
    if is_current_unsound:
        return _CURRENT.passes("The vehicle's current calibration fails its own checks, so it is no measure.")
    figures: dict[str, float | None] = {"heldout_mean_px": heldout_px, "current_heldout_mean_px": current_px}
    verdict: CheckVerdict = "pass"
    sentences: list[str] = []
    if apart is None:
        sentences.append("It cannot be compared with the vehicle's current calibration: one states no deviations.")
    else:
        figures |= {name: apart[name] for name in ("rotation_deg", "translation_mm", "sigmas", "field_px")}
        size = f"{apart['rotation_deg']:.2f} degrees and {apart['translation_mm']:.0f} mm"
        if apart["differs"]:
            # The mount and its lens differ together: over the image's points they may still agree.
            field_px = apart["field_px"]
            verdict = "look" if field_px is not None and field_px <= USE_LIMIT_PX else "stop"
            sentences.append(
                f"The mount differs from the vehicle's current calibration by {size}, {apart['sigmas']:.1f} times "
                "what both state: something moved, or one of them states too little."
            )
        else:
            sentences.append(f"It agrees with the vehicle's current calibration: {size} lie between them.")
    if heldout_px is not None and current_px is not None and heldout_px > max(_WORSE * current_px, _FINE_PX):
        verdict = "look" if verdict == "pass" else verdict
        sentences.append(
            f"Held-out pairs lie {heldout_px:.2f} px off, those of the vehicle's current calibration "
            f"{current_px:.2f} px."
        )
    return _CURRENT.fails(
        verdict, " ".join(sentences), "Compare the two results; if the mount moved, publish this one.", **figures
    )


def no_current() -> Check:
    """Return the check where the camera is given nothing."""
    return _CURRENT.passes("The vehicle has no current calibration of this camera.")
