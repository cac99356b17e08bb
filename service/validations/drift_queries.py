"""How a camera's calibration changed over time: its recommended results in their order."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Final, NamedTuple
from uuid import UUID

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from apexcal.documents.states import WorkState
from apexcal.documents.validations import Drift, DriftStep
from service.db.base import Json
from service.db.calibrations import FULL, Calibration, CalibrationRun, CorrespondenceSet, Result

# What is compared of a result; its document also has the errors of all its pairs.
COMPARED: Final = ("intrinsics", "transform", "std", "covariance", "field")


class _Recommended(NamedTuple):
    """A recommended result; ``at`` is when its pairs were brought."""

    id: UUID
    calibration_id: UUID
    model: str
    document: Json
    at: datetime
    spread: Json | None


def drift_of(session: Session, vehicle_id: UUID, camera: str, limit: int) -> Drift:
    """The newest recommended results of a camera, in the order of their pairs, each compared."""
    found = _recommended(session, vehicle_id, camera, limit)
    steps = [_step(found, place) for place in range(len(found))]
    return Drift(vehicle_id=vehicle_id, camera=camera, sentence=_sentence(camera, steps), steps=steps)


def _recommended(session: Session, vehicle_id: UUID, camera: str, limit: int) -> list[_Recommended]:
    pairs_at = func.coalesce(CorrespondenceSet.brought_at, CorrespondenceSet.created_at)
    statement = (
        select(Calibration.summary, func.max(pairs_at).label("at"))
        .join(CalibrationRun, CalibrationRun.calibration_id == Calibration.id)
        .join(CorrespondenceSet, CorrespondenceSet.id == CalibrationRun.set_id)
        .where(
            Calibration.vehicle_id == vehicle_id,
            Calibration.state == WorkState.DONE,
            CalibrationRun.camera == camera,
            CalibrationRun.fold == FULL,
        )
        .group_by(Calibration.id)
        .order_by(func.max(pairs_at).desc(), Calibration.id.desc())
        .limit(limit)
    )
    chosen: dict[UUID, tuple[datetime, Json | None]] = {}
    for summary, at in session.execute(statement):
        of_camera: Json = (summary or {}).get("cameras", {}).get(camera) or {}
        model: Json | None = of_camera.get("models", {}).get(of_camera.get("recommended"))
        if model:
            chosen[UUID(model["result_id"])] = at, model.get("between_models")
    of_results = select(
        Result.id, Result.calibration_id, Result.model, *(Result.document[name] for name in COMPARED)
    ).where(Result.id.in_(chosen))
    known: dict[UUID, Any] = {row[0]: row for row in session.execute(of_results)}
    found: list[_Recommended] = []
    for result_id, (at, spread) in chosen.items():
        if result_id in known:
            _, calibration_id, name, *parts = known[result_id]
            document: Json = dict(zip(COMPARED, parts, strict=True))
            found.append(_Recommended(result_id, calibration_id, name, document, at, spread))
    return found[::-1]


def _step(found: list[_Recommended], place: int) -> DriftStep:
    own = found[place]
    return DriftStep(
        result_id=own.id,
        calibration_id=own.calibration_id,
        model=own.model,
        at=own.at,
        intrinsics=own.document["intrinsics"],
        transform=own.document["transform"],
        from_previous=_apart(own, found[place - 1]) if place else None,  # pyright: ignore[reportArgumentType]
        from_first=_apart(own, found[0]) if place else None,  # pyright: ignore[reportArgumentType]
    )


def _apart(one: _Recommended, other: _Recommended) -> Json | None:
    # Imported here: it needs NumPy, which takes a twentieth of the service's start.
    from service.calibration_runs.result_comparison import compared

    return compared(one.document, other.document, one.spread, other.spread)


def _sentence(camera: str, steps: list[DriftStep]) -> str:
    if len(steps) < 2:
        return (
            f"{camera} has {len(steps) or 'no'} recommended result{'' if len(steps) == 1 else 's'}: drift needs two."
        )
    jumps = [step for step in steps[1:] if _differs(step.from_previous)]
    last: Json | None = steps[-1].from_first  # pyright: ignore[reportAssignmentType] - stored as it is
    said = f"Over {len(steps)} results of {camera} "
    if last is None:
        return said + "drift cannot be judged: not all of them state standard deviations."
    size = f"{last['rotation_deg']:.2f} degrees and {last['translation_mm']:.0f} mm"
    size += f" ({last['sigmas']:.1f} standard deviations)"
    if jumps:
        when = ", ".join(f"{step.at:%Y-%m-%d}" for step in jumps)
        return f"{said}the mount moved (at {when}). The last one differs from the first by {size}."
    if last["differs"]:
        return f"{said}no step is significant, but the last one differs from the first by {size}."
    return f"{said}the mount did not move significantly: the last one differs from the first by {size}."


def _differs(difference: object) -> bool:
    return isinstance(difference, dict) and bool(difference["differs"])
