"""Why cameras are given nothing, as problems."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from sqlalchemy import select
from sqlalchemy.orm import Session

from apexcal.documents.publications import CURRENT
from service.platform.db.calibrations import Publication
from service.platform.db.fleets import Rig, RigCamera, Vehicle
from service.platform.http.problems import Problem, conflict, not_found, unprocessable
from service.publications.mounted_sensors import LIDAR, Swapped
from service.publications.selection import Selection


def check_sensors(session: Session, vehicle: Vehicle, mounted: Mapping[str, str]) -> None:
    """Raises :class:`Problem` 422 ``unknown_sensor`` for a sensor that is in none of the vehicle's rigs."""
    rigs = select(RigCamera.name).join(Rig, Rig.id == RigCamera.rig_id).where(Rig.vehicle_id == vehicle.id)
    sensors = {LIDAR, *session.scalars(rigs)}
    strange = sorted(set(mounted) - sensors)
    if strange:
        raise unprocessable(
            "unknown_sensor",
            f"{vehicle.name!r} has no sensor {strange[0]!r}.",
            f"Its sensors are {', '.join(sorted(sensors))}.",
        )


def refuse_missing(vehicle: Vehicle, selection: Selection, missing: Sequence[str]) -> Problem:
    """404 ``no_calibration_yet``: the alias never led anywhere for these cameras; without any, for no camera."""
    which = f"the camera {missing[0]!r}" if missing else "any camera"
    when = f" until {selection.as_of.isoformat()}" if selection.as_of else ""
    if selection.alias != CURRENT:
        return not_found(
            "no_calibration_yet",
            f"The alias {selection.alias!r} led nowhere for {which} of {vehicle.name!r}{when}.",
            f'Publish a result with {{"alias": "{selection.alias}"}} (POST /v1/results/{{id}}/publication), or ask '
            "for `current`.",
        )
    return not_found(
        "no_calibration_yet",
        f"Nothing has been published for {which} of {vehicle.name!r}{when}.",
        "Publish a result: POST /v1/results/{id}/publication, or ask for a calibration with "
        '"publish": "recommended".',
    )


def refuse_nothing(
    vehicle: Vehicle, selection: Selection, moves: Sequence[tuple[Publication, str | None]]
) -> Problem:
    """410 ``calibration_deleted`` or ``calibration_withdrawn``. ``moves``: the last ones, each with who made it."""
    deleted = [move for move, _ in moves if move.led_to is not None]
    what = "calibration" if selection.alias == CURRENT else f"alias {selection.alias!r}"
    if deleted:
        first = deleted[0]
        return Problem(
            410,
            "calibration_deleted",
            f"The result of the {what} of the camera {first.camera!r} of {vehicle.name!r} was deleted. It was "
            f"published {first.created_at:%Y-%m-%d %H:%M} UTC.",
            "Publish another result: POST /v1/results/{id}/publication.",
            deleted=[
                {"camera": move.camera, "result_id": str(move.led_to), "published_at": move.created_at.isoformat()}
                for move in deleted
            ],
        )
    first, name = moves[0]
    more = f" ({len(moves) - 1} more in `withdrawn`)" if len(moves) > 1 else ""
    by = f" by {name}" if name else ""
    return Problem(
        410,
        "calibration_withdrawn",
        f"The {what} of the camera {first.camera!r} of {vehicle.name!r} was withdrawn{by}, "
        f"{first.created_at:%Y-%m-%d %H:%M} UTC: {first.reason}{more}",
        "Publish a result for it, or an older one again. `camera` narrows the answer to the others.",
        withdrawn=[
            {
                "camera": move.camera,
                "withdrawn_at": move.created_at.isoformat(),
                "withdrawn_by": by,
                "reason": move.reason,
            }
            for move, by in moves
        ],
    )


def refuse_swapped(vehicle: Vehicle, swapped: Sequence[Swapped]) -> Problem:
    """409 ``calibration_does_not_apply``."""
    more = f" ({len(swapped) - 1} more in `swapped`)" if len(swapped) > 1 else ""
    return conflict(
        "calibration_does_not_apply",
        f"The calibration of {vehicle.name!r} does not apply. {swapped[0].sentence}{more}",
        "Calibrate with the mounted sensors and publish that. `camera` narrows the answer to the others. If a serial "
        "number was mistyped, correct it: PATCH /v1/rigs/{id}/serials.",
        swapped=[sensor._asdict() for sensor in swapped],
    )
