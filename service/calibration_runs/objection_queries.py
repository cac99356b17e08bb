"""Objections to publishing a result, in sentences: the same for a person and for the service.

Objections to the result itself are found when its calibration ends, and kept in the calibration's summary. The others
depend on what the camera has at the moment of asking.
"""

from __future__ import annotations

from datetime import datetime
from typing import NamedTuple
from uuid import UUID

from sqlalchemy import ColumnElement, and_, exists, func, select
from sqlalchemy.orm import Session

from apexcal.documents.states import WorkState
from service.calibration_runs.gate_verdicts import failures, gate_verdict
from service.db.base import Json
from service.db.calibrations import Calibration, CalibrationRun, CorrespondenceSet, Result
from service.db.fleets import Rig, RigCamera
from service.publications.mounted_sensors import Calibrated, swapped_sensors
from service.publications.queries import current_publication, withdrawals

# Ratio of held-out to fitted error above which a fit says little about other places. Twenty real pairs for sixteen
# parameters give 3.3, enough pairs 1.1.
_FAR_HELD_OUT = 3.0
# Ratio to the current result's held-out error above which the vehicle should keep the current one.
_WORSE = 1.5
# Above this multiple of the noise that marks and vertices explain, held-out pairs contradict it.
_UNEXPLAINED = 1.5
# A held-out error below this never blocks publication.
_FINE_PX = 0.5
_NOT_ENDED = "Its calibration has not ended, so more may speak against it."


def objections(session: Session, result: Result) -> list[str]:
    """All objections to publishing this result, a fit to all pairs, for its camera now.

    What an older version of the service did not keep is computed here.
    """
    calibration = session.get_one(Calibration, result.calibration_id)
    summary = calibration.summary or {}
    found: Json = summary.get("cameras", {}).get(result.camera, {})
    model: Json | None = found.get("models", {}).get(result.model)
    if model is None:
        return [_NOT_ENDED]
    now = failures(gate_verdict(session, result)) + _said_of_it(session, result, calibration.vehicle_id)
    own: list[str] | None = model.get("objections")
    if own is None:
        ended_well = calibration.state == WorkState.DONE and _all_done(session, calibration.id)
        own = own_objections(result.camera, found, result.model, summary.get("rig"), ended_well=ended_well)
    return own + now + _beside_current(session, result, calibration.vehicle_id)


def _said_of_it(session: Session, result: Result, vehicle_id: UUID) -> list[str]:
    """Objections to a result that was withdrawn before, or whose sensor was swapped since."""
    withdrawn = [move for _, move in withdrawals(session, [result.id]) if move is not None]
    reasons = [f"It was withdrawn ({_told(move.created_at)}): {move.reason}" for move in withdrawn]
    mounted = session.execute(
        select(RigCamera.serial, Rig)
        .select_from(CalibrationRun)
        .join(CorrespondenceSet, CorrespondenceSet.id == CalibrationRun.set_id)
        .join(Rig, Rig.id == CorrespondenceSet.rig_id)
        .join(RigCamera, and_(RigCamera.rig_id == Rig.id, RigCamera.name == result.camera))
        .where(CalibrationRun.id == result.run_id)
    ).one_or_none()
    if mounted is not None:
        calibrated = [Calibrated(result.camera, *mounted)]
        reasons += [one.sentence for one in swapped_sensors(session, vehicle_id, calibrated)]
    return reasons


def own_objections(camera: str, found: Json, name: str, rig: Json | None, *, ended_well: bool) -> list[str]:
    """Objections to a model's fit to all pairs, whatever the vehicle has.

    A result has none if it was judged on held-out pairs, every run is done, and nothing needs a person's look first.
    ``found`` is the camera's summary, ``rig`` the comparison of the cameras.
    """
    model, recommended = found["models"][name], found["recommended"]
    reasons: list[str] = []
    if not recommended:
        reasons.append("No model is recommended.")
    elif name != recommended:
        reasons.append(f"{recommended} is recommended, not {name}. {found['why']}")
    if not ended_well:
        reasons.append("Not every fit ended well.")
    if model["status"] != "ok":
        reasons.append(f"The status of {name} is {model['status']}: {model['message']}")
    if model["at_bounds"]:
        listed = ", ".join(model["at_bounds"])
        reasons.append(f"{name} lies on the edge of its bounds ({listed}): widen them, or lock what is known.")
    # A worker of an older version does not say it.
    reasons += model.get("several_optima", []) + model.get("stated_too_small", [])
    reasons += _held_out(model) + _outside(model)
    if rig and name == recommended:
        # Other models were not compared.
        if rig.get("problem"):
            reasons.append(f"The cameras could not be compared: {rig['problem']['detail']}")
        reasons += [alarm for pair in rig["pairs"] if camera in pair["cameras"] for alarm in pair["alarms"]]
    return reasons


def _held_out(model: Json) -> list[str]:
    held_out, fitted = model["heldout_mean_px"], model["polished"]["mean_px"]
    if held_out is None:
        return ["No pairs were held out to judge it by."]
    reasons: list[str] = []
    if held_out > max(_FAR_HELD_OUT * fitted, _FINE_PX):
        reasons.append(
            f"Held-out pairs lie {held_out:.2f} px off, the fitted ones {fitted:.2f}: the pairs are too few, too "
            "uneven, or some of them wrong."
        )
    noise, explained = model.get("heldout_sigma_px"), model.get("explained_px")
    if noise and explained and noise > _UNEXPLAINED * explained:
        reasons.append(
            f"Held-out pairs show a noise of {noise:.1f} px per coordinate; what is stated of marks and vertices "
            f"explains {explained:.1f}: marks, vertices or times are worse than stated, or the model is wrong."
        )
    return reasons


def _outside(model: Json) -> list[str]:
    outside = model.get("marks_outside") or 0
    if not outside:
        return []
    noun = "mark lies" if outside == 1 else "marks lie"
    return [f"{outside} of {model['pairs']} {noun} outside of the image: nobody saw them there."]


def _all_done(session: Session, calibration_id: UUID) -> bool:
    other = exists().where(CalibrationRun.calibration_id == calibration_id, CalibrationRun.state != WorkState.DONE)
    return not session.scalar(select(other))


class _Standing(NamedTuple):
    """What two results of one camera are compared by."""

    result_id: UUID
    camera: str
    model: str
    document: Json
    summary: Json | None
    set_id: UUID
    pairs_at: datetime
    rig_id: UUID
    rig: str
    rig_at: datetime

    @property
    def found(self) -> Json:
        """The summary of its model."""
        models: Json = (self.summary or {}).get("cameras", {}).get(self.camera, {}).get("models", {})
        return models.get(self.model, {})

    @property
    def held_out_px(self) -> float | None:
        """Mean held-out error, where any pairs were held out."""
        return self.found.get("heldout_mean_px")


def _standing(session: Session, *where: ColumnElement[bool]) -> _Standing | None:
    # One statement: what it reads may be deleted between two.
    pairs_at = func.coalesce(CorrespondenceSet.brought_at, CorrespondenceSet.created_at)
    statement = (
        select(
            *(Result.id, Result.camera, Result.model, Result.document, Calibration.summary),
            *(CorrespondenceSet.id, pairs_at, Rig.id, Rig.name, Rig.created_at),
        )
        .join(Calibration, Calibration.id == Result.calibration_id)
        .join(CalibrationRun, CalibrationRun.id == Result.run_id)
        .join(CorrespondenceSet, CorrespondenceSet.id == CalibrationRun.set_id)
        .join(Rig, Rig.id == CorrespondenceSet.rig_id)
    )
    row = session.execute(statement.where(*where)).one_or_none()
    return _Standing(*row) if row else None


def _own_and_current(session: Session, result: Result, vehicle_id: UUID) -> tuple[_Standing, _Standing] | None:
    """A result and its camera's current one; None where there is none, it was withdrawn, or it is the same."""
    published = current_publication(session, vehicle_id, result.camera)
    # A withdrawn result is no standard.
    if published is None:
        return None
    own, current = _standing(session, Result.id == result.id), _standing(session, Result.id == published.result_id)
    if own is None or current is None or own.result_id == current.result_id:
        return None
    return own, current


def comparison(session: Session, result: Result, vehicle_id: UUID) -> Json | None:
    """How far a result is from its camera's current one."""
    found = _own_and_current(session, result, vehicle_id)
    return None if found is None else _compared(*found)


def spread_of_result(session: Session, result: Result) -> Json | None:
    """A result's deviations with other models counted, if there are any."""
    own = _standing(session, Result.id == result.id)
    return own.found.get("between_models") if own else None


def _compared(own: _Standing, current: _Standing) -> Json | None:
    # Imported here: it needs NumPy, which takes a twentieth of the service's start.
    from service.calibration_runs.result_comparison import compared

    spreads = own.found.get("between_models"), current.found.get("between_models")
    found = compared(own.document, current.document, *spreads)
    return found and found | {"result_id": str(current.result_id)}


def _beside_current(session: Session, result: Result, vehicle_id: UUID) -> list[str]:
    """Objections to a result that come from comparing it with its camera's current one."""
    found = _own_and_current(session, result, vehicle_id)
    if found is None:
        return []
    own, current = found
    reasons: list[str] = []
    # A result that is unsound by itself is no measure of the mount.
    apart = None if current.found.get("objections") else _compared(own, current)
    if apart and apart["differs"]:
        reasons.append(
            f"The mount differs from the vehicle's current result by {apart['rotation_deg']:.2f} degrees and "
            f"{apart['translation_mm']:.0f} mm, {apart['sigmas']:.1f} times what both state: something moved, or one "
            "of them states too little."
        )
    mine, theirs = own.held_out_px, current.held_out_px
    if mine is not None and theirs is not None and mine > max(_WORSE * theirs, _FINE_PX):
        reasons.append(f"Held-out pairs lie {mine:.2f} px off; of the vehicle's current result {theirs:.2f}.")
    if own.rig_id != current.rig_id and own.rig_at < current.rig_at:
        reasons.append(
            f"It is of the rig {own.rig!r}, the vehicle's current result of the newer rig {current.rig!r}."
        )
    if own.set_id != current.set_id and own.pairs_at < current.pairs_at:
        reasons.append(
            f"Its pairs are of {_told(own.pairs_at)}, those of the vehicle's current result are newer: of "
            f"{_told(current.pairs_at)}."
        )
    return reasons


def _told(moment: datetime) -> str:
    return f"{moment:%Y-%m-%d %H:%M:%S} UTC"
