"""Things of the service: ``ls``, ``show``, ``open`` and ``rm`` of vehicles, recordings and calibrations."""

from __future__ import annotations

import sys
import webbrowser
from collections.abc import Callable, Iterable
from datetime import datetime
from itertools import islice
from typing import Annotated, Any, Literal, NamedTuple
from uuid import UUID

import typer
from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table

from apexcal.client import Client
from apexcal.commands.calibrated import tables
from apexcal.commands.named import find_calibration, find_fleet, find_recording, find_vehicle, find_vehicle_camera
from apexcal.commands.options import CameraOption, FleetOption, LimitOption, VehicleOption, complete_name
from apexcal.commands.publishing import lines_of
from apexcal.commands.session import Reply, Session
from apexcal.commands.terminal import usage
from apexcal.documents.fleet_health import CameraHealth, HealthOrder
from apexcal.documents.states import CameraState, CameraWork

_SHOWN = 10
_Listed = Literal[
    "vehicles", "vehicle", "recordings", "recording", "calibrations", "calibration", "publications", "publication"
]
_Noun = Literal["vehicle", "recording", "calibration"]
NounArgument = Annotated[_Noun, typer.Argument(help="What kind of thing.")]
NameArgument = Annotated[
    str,
    typer.Argument(
        help="Its name, its id or @last; for a vehicle's newest calibration also the vehicle's name.",
        autocompletion=complete_name,
    ),
]


def ls(
    session: Session,
    what: Annotated[_Listed, typer.Argument()] = "vehicles",
    name: Annotated[str, typer.Argument()] = "",
    fleet: FleetOption = "",
    vehicle: VehicleOption = "",
    state: list[CameraState] | None = None,
    work: list[CameraWork] | None = None,
    order: HealthOrder = "vehicle",
    camera: CameraOption = "",
    limit: LimitOption = 20,
) -> Reply:
    """List a fleet's vehicles with what each camera gets and waits for. Or list recordings, or calibrations.

    Calibrations are of one vehicle, publications of one of its cameras, the newest first.
    `apexcal publish RESULT --reason WHY` publishes an older one again.

    Args:
        what: What to list.
        name: Only vehicles, cameras or recordings with this in their name.
        state: Of vehicles: only cameras in this state.
        work: Of vehicles: only cameras that wait for this; `decision` for a person's.
        order: Of vehicles: what to sort by; - turns it round.
    """
    client = session.client
    listed_kind = what.removesuffix("s")
    if listed_kind == "publication":
        with_rig, of_camera = find_vehicle_camera(client, fleet, vehicle or name, camera)
        moves = list(islice(client.calibrations.publications(with_rig.id, of_camera), limit))
        listed = [line for move in moves for line in lines_of(move)]
        return Reply(moves, "\n".join(listed) or f"Nothing was published for {of_camera} of {with_rig.name} yet.")
    if listed_kind == "calibration":
        on = find_vehicle(client, fleet, vehicle or name)
        calibrations = list(client.calibrations.list(on.id))
        rows = [
            (
                _moment(each.created_at),
                each.state,
                ", ".join(sorted({run.camera for run in each.runs})),
                ", ".join(
                    f"{camera}: {chosen.verdict}"
                    for camera, summary in (each.summary.cameras.items() if each.summary else ())
                    if (chosen := summary.models.get(summary.recommended or ""))
                ),
                str(each.id),
            )
            for each in calibrations
        ]
        return Reply(calibrations, _table(("Requested", "State", "Cameras", "Verdict", "Id"), rows))
    of = find_fleet(client, fleet)
    if listed_kind == "recording":
        by = find_vehicle(client, fleet, vehicle) if vehicle else None
        listed = client.recordings.list(fleet_id=of.id, vehicle_id=by and by.id)
        recordings = [each for each in listed if name.casefold() in each.name.casefold()]
        names = {each.id: each.name for each in client.vehicles.list(of.id)}
        rows = [
            (each.name, names.get(each.vehicle_id, ""), each.state, _moment(each.created_at), str(each.id))
            for each in recordings
        ]
        return Reply(recordings, _table(("Recording", "Vehicle", "State", "Added", "Id"), rows))
    only = find_vehicle(client, fleet, vehicle) if vehicle else None
    listed_cameras = client.vehicles.health(of.id, name=name, state=state or (), work=work or (), order=order)
    cameras = [each for each in listed_cameras if not only or each.vehicle_id == only.id]
    rows = [
        (
            each.vehicle,
            each.camera or "",
            _state(each),
            "" if each.error_20m_mm is None else f"{each.error_20m_mm:.0f} mm",
            _moment(each.published_at),
            _moment(each.recorded_at),
            each.work,
        )
        for each in cameras
    ]
    heads = ("Vehicle", "Camera", "State", "At 20 m", "Since", "Recorded", "Work")
    return Reply(cameras, _table(heads, rows))


class _Kind(NamedTuple):
    """A kind of things: its look-up, its deletion, and what a deletion takes with it."""

    find: Callable[[Client, str, str], Any]
    delete: Callable[[Client, UUID], None]
    goes_with: str


_KINDS: dict[_Noun, _Kind] = {
    "vehicle": _Kind(
        lambda c, fleet, name: find_vehicle(c, fleet, name),
        lambda c, id: c.vehicles.delete(id),
        "its rigs, recordings and calibrations",
    ),
    "recording": _Kind(
        lambda c, fleet, name: c.recordings.get(find_recording(c, name, fleet).id),
        lambda c, id: c.recordings.delete(id),
        "its frames, detections, marks and calibrations",
    ),
    "calibration": _Kind(
        lambda c, fleet, name: find_calibration(c, name, fleet),
        lambda c, id: c.calibrations.delete(id),
        "its results and reports",
    ),
}


def show(session: Session, kind: NounArgument, name: NameArgument, fleet: FleetOption = "") -> Reply:
    """Show a thing: its state, and the ids of what belongs to it."""
    client = session.client
    thing = _KINDS[kind].find(client, fleet, name)
    if kind == "calibration":
        ids = [
            f"{camera} {model}: result {run.result_id}"
            for camera, summary in (thing.summary.cameras.items() if thing.summary else ())
            for model, run in summary.models.items()
        ]
        head = f"The calibration {thing.id} of {_moment(thing.created_at)} is {thing.state}."
        after = f"apexcal open calibration {thing.id}"
        return Reply(thing, [head, *tables(thing), *ids], next=after)
    if kind == "recording":
        detections = list(client.detections.list(thing.id))
        sensors = ", ".join(f"{sensor.name} {sensor.count} messages" for sensor in thing.sensors)
        omissions = [each.sentence for each in thing.facts.omissions] if thing.facts else []
        lines = [f"The recording {thing.name!r} is {thing.id}, {thing.state}. {sensors}", *omissions, *thing.warnings]
        lines += [f"Detection {each.id}: {each.state}, {each.counts.accepted} corners" for each in detections]
        after = f"apexcal open recording {thing.id}" if detections else f"apexcal suggest {thing.id}"
        return Reply(thing, "\n".join(lines), next=after)
    health = client.vehicles.health(thing.fleet_id, name=thing.name)
    lines = [f"The vehicle {thing.name!r} is {thing.id}."]
    lines += [
        f"{each.camera or 'no camera'}: {', '.join(filter(None, (_state(each), f'work: {each.work}')))}"
        for each in health
        if each.vehicle_id == thing.id
    ]
    recordings = client.recordings.list(fleet_id=thing.fleet_id, vehicle_id=thing.id)
    lines += [f"Recording {each.name!r}: {each.id}, {each.state}" for each in islice(recordings, _SHOWN)]
    lines += [
        f"Calibration of {_moment(each.created_at)}: {each.id}, {each.state}"
        for each in islice(client.calibrations.list(thing.id), _SHOWN)
    ]
    return Reply(thing, "\n".join(lines), next=f"apexcal open vehicle {thing.id}")


def open(session: Session, kind: NounArgument, name: NameArgument, fleet: FleetOption = "") -> Reply:
    """Open the page of a thing in the browser, and print its address."""
    client = session.client
    thing = _KINDS[kind].find(client, fleet, name)
    address = f"{client.base_url.rstrip('/')}/{kind}s/{thing.id}"
    if sys.stdout.isatty():
        webbrowser.open(address)
    return Reply({"url": address, "id": str(thing.id)}, address)


def rm(
    session: Session,
    kind: NounArgument,
    name: NameArgument,
    fleet: FleetOption = "",
    yes: Annotated[bool, typer.Option("--yes", "-y")] = False,
) -> Reply:
    """Delete a thing and what belongs to it. The service refuses to delete what was published.

    Args:
        yes: Do not ask.
    """
    client, of = session.client, _KINDS[kind]
    thing = of.find(client, fleet, name)
    what = f"the {kind} {getattr(thing, 'name', '') or thing.id}"
    if not yes and not (sys.stdin.isatty() and typer.confirm(f"Delete {what} with {of.goes_with}?")):
        usage(f"{what} was not deleted", "Say --yes to delete it without a question")
    of.delete(client, thing.id)
    return Reply({"id": str(thing.id)}, f"Deleted {what} with {of.goes_with}.")


def _state(camera: CameraHealth) -> str:
    """Say what the vehicle gets for a camera, and which of its checks do not pass."""
    doubt = f", check: {camera.verdict}" if camera.verdict and camera.verdict != "pass" else ""
    return f"{camera.state or ''}{doubt}{', sensor swapped' if camera.is_swapped else ''}"


def _moment(at: datetime | None) -> str:
    return "" if at is None else f"{at.astimezone():%Y-%m-%d %H:%M}"


def _table(heads: Iterable[str], rows: list[tuple[str, ...]]) -> str | list[RenderableType]:
    if not rows:
        return "None."
    table = Table(*heads, box=None, pad_edge=False)
    for row in rows:
        table.add_row(*map(escape, row))
    return [table]
