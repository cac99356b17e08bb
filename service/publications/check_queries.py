"""All checks of a result at this moment: the stored ones, and those that only the database tells now."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Final, NamedTuple
from uuid import UUID

from sqlalchemy import Row, Select, and_, func, select
from sqlalchemy.orm import Session

from apexcal.documents.checks import Check, CheckTopic, later_checks
from apexcal.documents.publications import PublicationPolicy
from service.platform.db.calibrations import (
    Calibration,
    CalibrationRun,
    CorrespondenceSet,
    Result,
    current_publication,
)
from service.platform.db.fleets import Fleet, Rig, RigCamera
from service.publications.mounted_sensors import CalibratedSensor, swapped_sensors
from service.publications.policy_checks import policy_check, unattended_check
from service.publications.queries import withdrawals

_CURRENT: Final = CheckTopic("current", "The vehicle's current calibration")
_ENDED: Final = CheckTopic("ended", "End of the calibration")
_NEWEST: Final = CheckTopic("newest", "Newer rig or pairs")
_WITHDRAWN: Final = CheckTopic("withdrawn", "Withdrawals")
_SENSORS: Final = CheckTopic("sensors", "Mounted sensors")


class JudgedResult(NamedTuple):
    """The checks of a result now, and the policy of its rig and fleet."""

    checks: list[Check]
    policy: PublicationPolicy


def checks_now(session: Session, result: Result) -> list[Check]:
    """Return all checks of a fit to all pairs: those of its fit, its calibration and other data, and those of now."""
    return judged_now(session, result).checks


def judged_now(session: Session, result: Result) -> JudgedResult:
    """Return the checks as :func:`checks_now`, with the policy by which the result is published."""
    moment, policy = moment_checks(session, result)
    return JudgedResult(later_checks(result.stored_checks, moment), policy)


def moment_checks(session: Session, result: Result) -> JudgedResult:
    """Return the checks that only the database tells now, in place of stored ones of the same names."""
    own = session.execute(_origin(result.id)).one()
    policy = PublicationPolicy.model_validate((own.fleet_policy or {}) | (own.rig_policy or {}))
    published = current_publication(session, own.vehicle_id, result.camera)
    current = None if published is None or published.result_id is None else session.get(Result, published.result_id)
    beside = next((check for check in result.stored_checks if check.name == _CURRENT.name), None)
    checks = [
        _current(result, current, beside),
        _ended(result),
        _age(session, own, current if current is not None and current.id != result.id else None),
        _withdrawn(session, result),
        _sensors(session, result.camera, own),
    ]
    by_policy = (
        unattended_check(result, policy),
        policy_check(session, result, policy, later_checks(result.stored_checks, checks)),
    )
    return JudgedResult([*checks, *(check for check in by_policy if check)], policy)


def _origin(result_id: UUID) -> Select[*tuple[Any, ...]]:
    """A query for what a result was made of; one statement, because what it reads may be deleted between two."""
    return (
        select(
            *(Calibration.vehicle_id, CorrespondenceSet.id.label("set_id"), Rig, RigCamera.serial),
            func.coalesce(CorrespondenceSet.brought_at, CorrespondenceSet.created_at).label("pairs_at"),
            *(Rig.policy.label("rig_policy"), Fleet.policy.label("fleet_policy")),
        )
        .select_from(Result)
        .join(Calibration, Calibration.id == Result.calibration_id)
        .join(CalibrationRun, CalibrationRun.id == Result.run_id)
        .join(CorrespondenceSet, CorrespondenceSet.id == CalibrationRun.set_id)
        .join(Rig, Rig.id == CorrespondenceSet.rig_id)
        .join(Fleet, Fleet.id == Rig.fleet_id)
        .outerjoin(RigCamera, and_(RigCamera.rig_id == Rig.id, RigCamera.name == Result.camera))
        .where(Result.id == result_id)
    )


def _ended(result: Result) -> Check:
    return _ENDED.fails(
        "stop" if result.verdict is None else "pass",
        "Its calibration has not ended, or was cancelled: the result was not compared with the other fits."
        if result.verdict is None
        else "Its calibration has ended.",
        "Wait for the end of the calibration, or calibrate again.",
    )


def _current(result: Result, current: Result | None, beside: Check | None) -> Check:
    """The comparison with the current calibration, or that another became it since the result was judged."""
    if current is None:
        return _CURRENT.not_checked("The vehicle has no current calibration of this camera.", "Publish a result.")
    if current.id == result.id:
        return _CURRENT.passes("It is the vehicle's current calibration.")
    if current.verdict == "stop":
        return _CURRENT.not_checked(
            "The vehicle's current calibration fails its own checks.",
            "Publish a result that passes its checks.",
        )
    if beside is not None and result.compared_with == current.id:
        return beside
    return _CURRENT.fails(
        "look",
        "Another calibration became the vehicle's current one since this result was judged.",
        "Compare the two results; publish this one if it is the better one.",
    )


def _age(session: Session, own: Row[*tuple[Any, ...]], current: Result | None) -> Check:
    """Whether the current calibration is of a newer rig or newer pairs."""
    other = None if current is None else session.execute(_origin(current.id)).one_or_none()
    newer: list[str] = []
    if other is not None and own.Rig.id != other.Rig.id and own.Rig.created_at < other.Rig.created_at:
        newer.append(
            f"This result is of the rig {own.Rig.name!r}, the vehicle's current calibration of the newer rig "
            f"{other.Rig.name!r}."
        )
    if other is not None and own.set_id != other.set_id and own.pairs_at < other.pairs_at:
        newer.append(
            f"This result's pairs are of {_in_words(own.pairs_at)}, those of the vehicle's current calibration are "
            f"newer: of {_in_words(other.pairs_at)}."
        )
    return _NEWEST.fails(
        "look" if newer else "pass",
        " ".join(newer) or "No current calibration is of a newer rig or newer pairs.",
        "Calibrate from the newest pairs.",
    )


def _withdrawn(session: Session, result: Result) -> Check:
    reasons = [
        f"It was withdrawn ({_in_words(move.created_at)}): {move.reason}"
        for _, move in withdrawals(session, [result.id])
        if move is not None
    ]
    return _WITHDRAWN.fails(
        "stop" if reasons else "pass", " ".join(reasons) or "It was never withdrawn.", "Publish another result."
    )


def _sensors(session: Session, camera: str, own: Row[*tuple[Any, ...]]) -> Check:
    if own.serial is None and own.Rig.lidar.serial is None:
        return _SENSORS.not_checked(
            "The rig states no serial numbers, so that nobody would notice a swapped sensor.",
            "State serial numbers of camera and LiDAR with the rig.",
        )
    swapped = swapped_sensors(session, own.vehicle_id, [CalibratedSensor(camera, own.serial, own.Rig)])
    return _SENSORS.fails(
        "stop" if swapped else "pass",
        " ".join(sensor.sentence for sensor in swapped) or "No serial number says that a sensor was swapped.",
        "Calibrate the sensors that are mounted now.",
    )


def _in_words(moment: datetime) -> str:
    return f"{moment:%Y-%m-%d %H:%M:%S} UTC"
