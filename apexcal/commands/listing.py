"""What the service has: ``ls``."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import datetime
from typing import Annotated, Literal

import typer
from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table

from apexcal.commands.named import find_fleet, find_vehicle
from apexcal.commands.options import FleetOption, VehicleOption
from apexcal.commands.session import Reply, Session
from apexcal.documents.fleet_health import HealthOrder
from apexcal.documents.states import CameraState

_Listed = Literal["vehicles", "recordings", "calibrations"]


def ls(
    session: Session,
    what: Annotated[_Listed, typer.Argument(help="What to list.")] = "vehicles",
    name: Annotated[str, typer.Argument(help="Only vehicles, cameras or recordings with this in their name.")] = "",
    fleet: FleetOption = "",
    vehicle: VehicleOption = "",
    state: Annotated[list[CameraState] | None, typer.Option(help="Of vehicles: only cameras in this state.")] = None,
    order: Annotated[HealthOrder, typer.Option(help="Of vehicles: what to sort by; - turns it round.")] = "vehicle",
) -> Reply:
    """List the vehicles of a fleet with what each camera is given and waits for; or recordings, or calibrations.

    Calibrations are those of one vehicle.
    """
    client = session.client
    if what == "calibrations":
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
    if what == "recordings":
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
    listed_cameras = client.vehicles.health(of.id, name=name, state=state or (), order=order)
    cameras = [each for each in listed_cameras if not only or each.vehicle_id == only.id]
    rows = [
        (
            each.vehicle,
            each.camera or "",
            each.state.replace("_", " "),
            "" if each.error_20m_mm is None else f"{each.error_20m_mm:.0f} mm",
            _moment(each.published_at),
            _moment(each.recorded_at),
            (each.waits_for or "").replace("_", " "),
        )
        for each in cameras
    ]
    heads = ("Vehicle", "Camera", "State", "At 20 m", "Since", "Recorded", "Waits for")
    return Reply(cameras, _table(heads, rows))


def _moment(at: datetime | None) -> str:
    return "" if at is None else f"{at.astimezone():%Y-%m-%d %H:%M}"


def _table(heads: Iterable[str], rows: list[tuple[str, ...]]) -> str | list[RenderableType]:
    if not rows:
        return "None."
    table = Table(*heads, box=None, pad_edge=False)
    for row in rows:
        table.add_row(*map(escape, row))
    return [table]
