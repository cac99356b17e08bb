"""Things of the service that a command names by name or id."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from difflib import get_close_matches
from typing import Any, NamedTuple, NoReturn, TypeVar
from uuid import UUID

from apexcal.client import Client, ClientError
from apexcal.commands.terminal import usage
from apexcal.documents.calibrations import CalibrationView
from apexcal.documents.detections import DetectionView
from apexcal.documents.fleets import FleetOut, RigOut, VehicleOut
from apexcal.documents.recordings import RecordingSummary

Named = TypeVar("Named", FleetOut, VehicleOut, RigOut, RecordingSummary)

LAST = "@last"
"""The newest thing of its kind, instead of a name or an id."""
_SHOWN = 20
_MADE_BY_RIG = "apexcal rig rig.json --fleet F --vehicle V"


class _Resource(NamedTuple):
    """Names of one kind of things in commands: the option, what tells equal names apart, what makes the first."""

    option: str
    label: Callable[[Client, Any], str] = lambda client, thing: str(thing.id)
    made_by: str = _MADE_BY_RIG


_RESOURCES = {
    "fleet": _Resource("with --fleet"),
    "vehicle": _Resource(
        "with --vehicle",
        lambda client, vehicle: f"{vehicle.id} in the fleet {client.fleets.get(vehicle.fleet_id).name!r}",
    ),
    "rig": _Resource("with --rig"),
    "recording": _Resource(
        "instead of the name",
        lambda client, recording: f"{recording.id}, {recording.state}, of {recording.created_at}",
        "apexcal upload FILE",
    ),
}
_WHERE_IDS_ARE = {
    "fleet request": "`apexcal calibrate-fleet` prints it, and it stands in the address of the request's page",
    "correspondence set": "`apexcal calibrate --json` prints it",
}


def pick(client: Client, things: Iterable[Named], what: str, name: str) -> Named:
    """The thing with this id or name; without one, the only thing there is. Raises :class:`ClientError`.

    If there are several and none is named, the command ends as called wrongly.
    """
    things = list(things)
    if name == LAST and things:
        return max(things, key=lambda thing: thing.created_at)
    matching = [thing for thing in things if not name or name in (str(thing.id), thing.name)]
    if len(matching) != 1:
        _refuse_to_pick(client, things, matching, what, name)
    return matching[0]


def _refuse_to_pick(client: Client, things: list[Named], matching: list[Named], what: str, name: str) -> NoReturn:
    option, label, made_by = _RESOURCES[what]
    names = ", ".join(f"{thing.name!r}" for thing in things[:_SHOWN])
    if len(things) > _SHOWN:
        names += f" and {len(things) - _SHOWN:,} more"
    if not things:
        raise ClientError(f"there is no {what} yet", f"Make one first: `{made_by}`.")
    if not matching:
        by_fold = {thing.name.casefold(): thing.name for thing in things}
        near = [f"{by_fold[fold]!r}" for fold in get_close_matches(name.casefold(), by_fold)]
        nearest = f"The nearest of {len(things):,}: {', '.join(near)}" if near else f"There is: {names}"
        raise ClientError(f"there is no {what} with the name or id {name!r}", nearest)
    if name:
        ids = "".join(f"\n  {label(client, thing)}" for thing in matching[:_SHOWN])
        raise ClientError(f"several {what}s are called {name!r}:{ids}", f"Give the id {option}.")
    usage(f"there are several {what}s: {names}", f"Say which one {option}.")


def find_fleet(client: Client, name: str) -> FleetOut:
    """A fleet by id or name."""
    return pick(client, client.fleets.list(), "fleet", name)


def find_vehicle(client: Client, fleet: str, name: str) -> VehicleOut:
    """A vehicle by id, or by name in a fleet or in all of the caller's fleets."""
    if is_id(name):
        return client.vehicles.get(name)
    fleets = [find_fleet(client, fleet)] if fleet else client.fleets.list()
    return pick(client, (vehicle for each in fleets for vehicle in client.vehicles.list(each.id)), "vehicle", name)


def find_rig(client: Client, vehicle: VehicleOut, name: str) -> RigOut:
    """A vehicle's rig by id or name."""
    return pick(client, client.vehicles.rigs(vehicle.id), "rig", name)


def find_recording(client: Client, name: str, fleet: str = "") -> RecordingSummary:
    """A recording by id, or by name in a fleet or among all that the caller may see. Raises :class:`ClientError`."""
    if not name.strip():
        usage("the recording's name is empty", "Give its id or name; `apexcal upload` prints both")
    if is_id(name):
        return client.recordings.get(name)
    of = find_fleet(client, fleet).id if fleet else None
    return pick(client, client.recordings.list(fleet_id=of), "recording", name)


def find_detection(client: Client, name: str) -> DetectionView:
    """A detection by id, or the newest of a recording by the recording's name; ``@last``: of the newest recording."""
    if is_id(name):
        return client.detections.get(name)
    recording = find_recording(client, name)
    newest = next(iter(client.detections.list(recording.id)), None)
    if newest is None:
        raise ClientError(f"{recording.name!r} has no detection yet", f"Make one: `apexcal suggest {recording.id}`.")
    return newest


def find_calibration(client: Client, name: str, fleet: str = "", vehicle: str = "") -> CalibrationView:
    """A calibration by id, or the newest of a vehicle by the vehicle's name; ``@last``: of all vehicles."""
    if is_id(name):
        return client.calibrations.get(name)
    if name == LAST and not vehicle:
        fleets = [find_fleet(client, fleet)] if fleet else list(client.fleets.list())
        on = [each for of in fleets for each in client.vehicles.list(of.id)]
    else:
        on = [find_vehicle(client, fleet, vehicle if name == LAST else name)]
    newest = [each for of in on if (each := next(client.calibrations.list(of.id), None))]
    if not newest:
        raise ClientError("there is no calibration yet", "Make one first: `apexcal calibrate --detection @last`.")
    return max(newest, key=lambda each: each.created_at)


def find_result(client: Client, name: str, camera: str = "") -> str:
    """The id of a result: given as such, or what the calibration of this name recommends for a camera.

    ``name``: a result's id, a vehicle's name (its newest calibration), or ``@last``.
    """
    if is_id(name):
        return name
    calibration = find_calibration(client, name)
    cameras = calibration.summary.cameras if calibration.summary else {}
    recommended = {
        of: summary.models[summary.recommended].result_id
        for of, summary in cameras.items()
        if summary.recommended is not None
    }
    if not recommended:
        raise ClientError(f"the calibration {calibration.id} recommends no result", f"It is {calibration.state}.")
    of = camera or next(iter(recommended))
    if of not in recommended or (not camera and len(recommended) > 1):
        usage(f"the calibration has results of {', '.join(recommended)}", "Say of which camera with --camera")
    return str(recommended[of])


def find_camera(rigs: Iterable[RigOut], name: str) -> str:
    """The camera of this name; without one, the only one of these rigs."""
    cameras = list(dict.fromkeys(camera.name for rig in rigs for camera in rig.cameras))
    if name in cameras:
        return name
    if name:
        usage(f"the rig has no camera {name!r}", f"Its cameras are {', '.join(cameras)}")
    if len(cameras) != 1:
        usage("the rig has several cameras", f"Say which one with --camera: {', '.join(cameras)}")
    return cameras[0]


def find_vehicle_camera(client: Client, fleet: str, vehicle: str, camera: str) -> tuple[VehicleOut, str]:
    """A vehicle, and the name of a camera of any of its rigs."""
    on = find_vehicle(client, fleet, vehicle)
    return on, find_camera(client.vehicles.rigs(on.id), camera)


def check_id(text: str, what: str) -> str:
    """The text, where it is an id. Where it is none the command was called wrongly, and says where ids are."""
    if not is_id(text):
        usage(f"{text!r} is no id of a {what}", _WHERE_IDS_ARE[what])
    return text


def assignments(texts: Sequence[str] | None, option: str, example: str) -> dict[str, str]:
    """``NAME=VALUE`` options by name. Any other form ends the command as wrong usage."""
    pairs: dict[str, str] = {}
    for text in texts or ():
        name, _, value = (part.strip() for part in text.partition("="))
        if not (name and value):
            usage(f"{option} {text!r} is not NAME=VALUE", f"Write it as {option} {example}")
        pairs[name] = value
    return pairs


def is_id(text: str) -> bool:
    """Whether this is an id, and no name."""
    try:
        UUID(text)
    except ValueError:
        return False
    return True
