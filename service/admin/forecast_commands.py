"""``apexcal admin forecast``: what a year will need, by what the last weeks brought."""

from __future__ import annotations

import json
from collections import defaultdict
from typing import Annotated, Any, NamedTuple
from uuid import UUID

import typer
from sqlalchemy import ColumnElement, Select, func, select
from sqlalchemy.orm import Session

from service.admin.context import JsonOption, opened, spoken, table
from service.platform.db.annotations import Answer, MarkingTask
from service.platform.db.calibrations import CalibrationRun, CorrespondenceSet, Slot
from service.platform.db.clock import now
from service.platform.db.detections import Apex, Detection, Vertex, VertexFrame
from service.platform.db.fleets import Fleet
from service.platform.db.recordings import LAYERS, Blob, CameraFrame, Recording, Sensor
from service.platform.storage.quota import spoken as said

_DAY_S = 86400.0
_YEAR = 365.0


class _Growth(NamedTuple):
    """Bytes of each layer, rows, and recordings that came within some days."""

    layers: dict[str, int]
    rows: int
    recordings: int


@spoken
def forecast(
    days: Annotated[int, typer.Option(help="How far back the pace is measured.", min=1)] = 30,
    as_json: JsonOption = False,
) -> None:
    """Show what each fleet will take a year from now at its present pace, with its retention and without."""
    with opened() as service, service.database.reading() as session:
        fleets = session.execute(select(Fleet.id, Fleet.name, Fleet.retention).order_by(Fleet.name)).all()
        growth = _growth(session, days)
    lines: list[dict[str, Any]] = []
    for fleet_id, name, retention in fleets:
        brought = growth[fleet_id]
        a_day = {layer: size / days for layer, size in brought.layers.items()}
        ends = {layer: min(_YEAR, (retention or {}).get(layer, _YEAR)) for layer in LAYERS}
        lines.append(
            {
                "fleet": name,
                "recordings": brought.recordings,
                "bytes_a_year": round(_YEAR * sum(a_day.values())),
                "with_retention": round(sum(ends[layer] * size for layer, size in a_day.items())),
                "rows_a_year": round(_YEAR * brought.rows / days),
            }
        )
    if as_json:
        print(json.dumps(lines, indent=2))
        return
    for line in lines:
        line |= {name: said(line[name]) for name in ("bytes_a_year", "with_retention")}
    print(table(lines, ("fleet", "recordings", "bytes_a_year", "with_retention", "rows_a_year")))
    print(f"\nBy the recordings and results of the last {days} days.")


def _growth(session: Session, days: int) -> defaultdict[UUID, _Growth]:
    recent = Recording.created_at > now(-_DAY_S * days)
    growths: defaultdict[UUID, _Growth] = defaultdict(lambda: _Growth(dict.fromkeys(LAYERS, 0), 0, 0))

    def count(statement: Select[Any, Any], layer: str = "") -> None:
        for fleet_id, number in session.execute(statement):
            growth = growths[fleet_id]
            if layer:
                growth.layers[layer] += int(number or 0)
            else:
                growths[fleet_id] = growth._replace(rows=growth.rows + int(number or 0))

    for fleet_id, number, size in session.execute(
        select(Recording.fleet_id, func.count(), func.sum(Recording.size)).where(recent).group_by(Recording.fleet_id)
    ):
        growths[fleet_id] = growths[fleet_id]._replace(recordings=number)
        growths[fleet_id].layers["original"] += int(size or 0)
    of_sensors = select(Recording.fleet_id, func.sum(Blob.size)).select_from(Sensor)
    of_sensors = of_sensors.join(Recording, Recording.id == Sensor.recording_id).where(recent)
    by_kind = {"images": Sensor.kind == "camera", "sweeps": Sensor.kind == "lidar"}
    for layer, is_kind in by_kind.items():
        stored = of_sensors.join(Blob, Blob.key == Sensor.blob_key).where(is_kind)
        count(stored.group_by(Recording.fleet_id), layer)
    for table_, joins in _ROWS.items():
        statement = select(Recording.fleet_id, func.count()).select_from(table_)
        for other, on in joins:
            statement = statement.join(other, on)
        count(statement.where(recent).group_by(Recording.fleet_id))
    run = CalibrationRun.created_at > now(-_DAY_S * days)
    slots = select(CalibrationRun.fleet_id, func.count()).join(Slot, Slot.run_id == CalibrationRun.id)
    count(slots.where(run).group_by(CalibrationRun.fleet_id))
    count(select(CalibrationRun.fleet_id, func.count()).where(run).group_by(CalibrationRun.fleet_id))
    return growths


_Join = tuple[Any, ColumnElement[bool]]
_OF_SENSOR: _Join = (Recording, Recording.id == Sensor.recording_id)
_OF_DETECTION: _Join = (Recording, Recording.id == Detection.recording_id)
# The tables with the most rows of a recording, and how they lead to it.
_ROWS: dict[Any, tuple[_Join, ...]] = {
    CameraFrame: ((Sensor, Sensor.id == CameraFrame.sensor_id), _OF_SENSOR),
    Answer: ((Recording, Recording.id == Answer.recording_id),),
    Apex: ((Recording, Recording.id == Apex.recording_id),),
    CorrespondenceSet: ((Recording, Recording.id == CorrespondenceSet.recording_id),),
    Vertex: ((Detection, Detection.id == Vertex.detection_id), _OF_DETECTION),
    VertexFrame: (
        (Vertex, Vertex.id == VertexFrame.vertex_id),
        (Detection, Detection.id == Vertex.detection_id),
        _OF_DETECTION,
    ),
    MarkingTask: ((Detection, Detection.id == MarkingTask.detection_id), _OF_DETECTION),
}
