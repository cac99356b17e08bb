"""Whether a recommended result becomes what the vehicle is given, without a person having looked at it."""

from __future__ import annotations

from uuid import UUID

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.db.base import Json
from service.db.calibrations import Calibration, Publication, Result

# Held-out pairs that lie so many times further off than the fitted ones: the fit says little about where it was not
# fitted. Twenty real pairs for sixteen parameters come to 3.3, pairs enough to 1.1.
_FAR_HELD_OUT = 3.0
# And so many times further off than those of the result that the vehicle has: it would rather keep that.
_WORSE = 1.5
# Below this no held-out error is a reason: whoever marks it so well has nothing to fear.
_FINE_PX = 0.5


def against_publishing(
    session: Session, calibration: Calibration, camera: str, found: Json, rig: Json | None, *, all_done: bool
) -> list[str]:
    """Why the recommended result does not become the vehicle's current one by itself, in sentences; none: it does.

    A vehicle is given by itself only what was judged on pairs that it was not fitted to, with every run done, and
    with nothing that a person should look at first. ``found`` is the camera's summary.
    """
    if not found["recommended"]:
        return ["No model is recommended."]
    name, model = found["recommended"], found["models"][found["recommended"]]
    reasons: list[str] = []
    if not all_done:
        reasons.append("Not every fit ended well.")
    if model["status"] != "ok":
        reasons.append(f"The status of {name} is {model['status']}: {model['message']}")
    if model["at_bounds"]:
        listed = ", ".join(model["at_bounds"])
        reasons.append(f"{name} lies on the edge of its bounds ({listed}): widen them, or lock what is known.")
    reasons += model["several_optima"] + _held_out(session, calibration, camera, model)
    if rig and rig.get("problem"):
        reasons.append(f"The cameras could not be compared: {rig['problem']['detail']}")
    for pair in rig["pairs"] if rig else []:
        if camera in pair["cameras"]:
            reasons += pair["alarms"]
    return reasons


def publish(session: Session, calibration: Calibration, camera: str, result_id: UUID) -> None:
    """Make a result what the vehicle's camera is given."""
    session.add(
        Publication(
            fleet_id=calibration.fleet_id,
            vehicle_id=calibration.vehicle_id,
            camera=camera,
            result_id=result_id,
            published_by=calibration.created_by,
        )
    )


def _held_out(session: Session, calibration: Calibration, camera: str, model: Json) -> list[str]:
    """What the held-out pairs say against a result."""
    held_out, fitted = model["heldout_mean_px"], model["polished"]["mean_px"]
    if held_out is None:
        return ["No pairs were held out to judge it by."]
    reasons: list[str] = []
    if held_out > max(_FAR_HELD_OUT * fitted, _FINE_PX):
        reasons.append(
            f"Held-out pairs lie {held_out:.2f} px off, the fitted ones {fitted:.2f}: the pairs are too few, too "
            "uneven, or some of them wrong."
        )
    current = _current_held_out(session, calibration.vehicle_id, camera)
    if current is not None and held_out > max(_WORSE * current, _FINE_PX):
        reasons.append(f"Held-out pairs lie {held_out:.2f} px off; of the vehicle's current result {current:.2f}.")
    return reasons


def _current_held_out(session: Session, vehicle_id: UUID, camera: str) -> float | None:
    """Mean held-out error of what the camera is given now, where its calibration held any pairs out."""
    newest = (
        select(Calibration.summary, Result.model)
        .join(Result, Result.calibration_id == Calibration.id)
        .join(Publication, Publication.result_id == Result.id)
        .where(Publication.vehicle_id == vehicle_id, Publication.camera == camera)
        .order_by(Publication.created_at.desc(), Publication.id.desc())
        .limit(1)
    )
    row = session.execute(newest).one_or_none()
    models: Json = ((row.summary or {}).get("cameras", {}).get(camera, {}) if row else {}).get("models", {})
    return models.get(row.model, {}).get("heldout_mean_px") if row else None
