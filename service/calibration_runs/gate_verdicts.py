"""Checks a result against its rig's and fleet's gates. Failed limits become objections to publishing it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from sqlalchemy import and_, select
from sqlalchemy.orm import Session

from apexcal.documents.camera_models import EXTRINSICS
from service.db.base import Json
from service.db.calibrations import Calibration, CalibrationRun, CorrespondenceSet, Result
from service.db.fleets import Fleet, Rig, RigCamera

# Cells of the image, as `apexcal.documents.gates.Gate` defines coverage.
_COLUMNS, _ROWS = 8, 6
# As results name their deviations, in degrees and metres.
_TURNS = tuple(name for names in EXTRINSICS.values() for name in names[:3])
_SHIFTS = EXTRINSICS["rotation_vector"][3:]


class _Limit(NamedTuple):
    """What a gate asks of one measure, in words; ``sign`` is 1 for an upper limit, -1 for a lower."""

    what: str
    unit: str
    sign: int = 1


_LIMITS = {
    "heldout_mean_px": _Limit("the mean error of held-out pairs", "px"),
    "std_deg": _Limit("the largest standard deviation of a turn", "degrees"),
    "std_mm": _Limit("the largest standard deviation of the translation", "mm"),
    "halves_ratio": _Limit("the difference of halves of the pairs over what is stated", ""),
    "coverage": _Limit("the share of the image's cells that hold a pair", "", -1),
}


def gate_verdict(session: Session, result: Result) -> Json | None:
    """Whether a fit to all pairs passes the gates of its rig and fleet now; None where neither states one."""
    found = session.execute(
        select(Calibration.summary, CorrespondenceSet, Rig.gate, Fleet.gate, RigCamera)
        .select_from(Result)
        .join(Calibration, Calibration.id == Result.calibration_id)
        .join(CalibrationRun, CalibrationRun.id == Result.run_id)
        .join(CorrespondenceSet, CorrespondenceSet.id == CalibrationRun.set_id)
        .join(Rig, Rig.id == CorrespondenceSet.rig_id)
        .join(Fleet, Fleet.id == Rig.fleet_id)
        .outerjoin(RigCamera, and_(RigCamera.rig_id == Rig.id, RigCamera.name == Result.camera))
        .where(Result.id == result.id)
    ).one_or_none()
    if found is None:
        return None
    summary, pairs, of_rig, of_fleet, camera = found
    limits = {name: (limit, "fleet") for name, limit in (of_fleet or {}).items()}
    limits |= {name: (limit, "rig") for name, limit in (of_rig or {}).items()}
    if not limits:
        return None
    measured = _measures(result, summary, pairs.columns, camera, with_coverage="coverage" in limits)
    # A limit unknown to this version was stated for a newer one; it must not pass unseen.
    checks = [_check(name, limit, measured.get(name), by) for name, (limit, by) in sorted(limits.items())]
    return {"passed": all(check["passed"] for check in checks), "checks": checks}


def failures(verdict: Json | None) -> list[str]:
    """The objections of a verdict, in sentences."""
    return [check["reason"] for check in verdict["checks"] if not check["passed"]] if verdict else []


def _check(name: str, limit: float, measured: float | None, by: str) -> Json:
    known = _LIMITS.get(name, _Limit(name, ""))
    passed = measured is not None and known.sign * measured <= known.sign * limit
    reason = None
    if not passed:
        unit = f" {known.unit}" if known.unit else ""
        bound = "at most" if known.sign == 1 else "at least"
        is_now = f"it is {measured:.3g}{unit}" if measured is not None else "this result does not have it"
        reason = f"The gate of the {by} asks for {bound} {limit:g}{unit} as {known.what}; {is_now}."
    return {
        "name": name, "limit": limit, "measured": measured, "passed": passed, "stated_by": by, "reason": reason
    }  # fmt: skip


def _measures(
    result: Result, summary: Json | None, pairs: Json, camera: RigCamera | None, *, with_coverage: bool
) -> dict[str, float | None]:
    models: Json = (summary or {}).get("cameras", {}).get(result.camera, {}).get("models", {})
    summed: Json = models.get(result.model, {})
    # As published: with the spread of the models, if they were weighed.
    stated: Json = summed.get("between_models") or result.document
    std: Mapping[str, float | None] = stated.get("std") or {}
    metres = _largest(std, _SHIFTS)
    return {
        "heldout_mean_px": summed.get("heldout_mean_px"),
        "halves_ratio": max((half["ratio"] for half in result.document.get("halves") or []), default=None),
        "std_deg": _largest(std, _TURNS),
        "std_mm": None if metres is None else 1000.0 * metres,
        "coverage": _coverage(result.document, pairs, camera) if with_coverage and camera else None,
    }


def _largest(std: Mapping[str, float | None], names: Sequence[str]) -> float | None:
    """The largest of these deviations; None if there is none, or one of them is not determined."""
    found = [std[name] for name in names if name in std]
    known = [one for one in found if one is not None]
    return max(known) if known and len(known) == len(found) else None


def _coverage(document: Json, pairs: Json, camera: RigCamera) -> float | None:
    """The share of the image's cells that hold at least one pair that the fit did not leave out."""
    u: Sequence[Any] = pairs.get("u", ())
    v: Sequence[Any] = pairs.get("v", ())
    left_out = {one["index"] for one in document.get("outliers", []) if one.get("excluded")}
    cells = {
        (int(_COLUMNS * x / camera.image_width), int(_ROWS * y / camera.image_height))
        for index, (x, y) in enumerate(zip(u, v, strict=True))
        if index not in left_out and 0 <= x < camera.image_width and 0 <= y < camera.image_height
    }
    return len(cells) / (_COLUMNS * _ROWS) if u else None
