"""A database with a long history: as many ended runs as wanted with all that belongs to them, a statement a table.

Ids are numbers written as UUIDs, so rows of one number belong together and sort by it, as by the time.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any
from uuid import UUID

from sqlalchemy import Connection, text

from service.platform.db import models
from service.platform.db.base import Base
from service.platform.db.session import Database
from tests.support.rows import USUAL

# Rows of one kind begin here, so that no two tables share an id.
FLEET, PERSON, VEHICLE, RIG = (UUID(int=kind << 96) for kind in range(1, 5))
_CAMERA, _SET, _CALIBRATION, _RUN, _RESULT, _PUBLICATION, _REQUEST, _ASKED, _OTHER = range(5, 14)
_RECORDING, _SENSOR, _DETECTION, _APEX, _VERTEX, _ANSWER, _TASK, _KEY, _QUIET_FLEET, _LIDAR = range(14, 24)

QUIET_FLEET = UUID(int=_QUIET_FLEET << 96)
RECORDING, CAMERA, DETECTION = (UUID(int=kind << 96) for kind in (_RECORDING, _SENSOR, _DETECTION))
RUNS_OF_A_CALIBRATION = 4
# Microseconds: the newest row is some minutes old, a million runs are of 58 days.
_MINUTE = 60_000_000
_APART = 20_000_000
_SENT_JOBS = 20
# What a vehicle's document takes from a result.
_RESULT_JSON = {"intrinsics": {}, "transform": {}, "polished": {"mean_px": 1.0, "rms_px": 1.0}}


@dataclass(frozen=True)
class Size:
    """How much there is: ``runs`` of calibrations that ended, of so many ``vehicles``; ``answered`` vertices."""

    runs: int
    vehicles: int = 100
    answered: int = 0

    @property
    def calibrations(self) -> int:
        return self.runs // RUNS_OF_A_CALIBRATION


class _Filler:
    """Inserts as both databases understand it."""

    def __init__(self, connection: Connection, now_us: int) -> None:
        self._connection = connection
        self._postgresql = connection.dialect.name == "postgresql"
        self._now_us = now_us

    def id(self, kind: int, number: str = "n") -> str:
        """SQL of the id of this kind and number."""
        if self._postgresql:
            return f"(lpad(to_hex({kind}), 8, '0') || lpad(to_hex({number}), 24, '0'))::uuid"
        return f"printf('%08x%024x', {kind}, {number})"

    def at(self, newest_minutes_ago: int = 5, number: str = "n", count: int = 0) -> str:
        """SQL of a moment: the last of ``count`` rows is the newest."""
        return f"({self._now_us - newest_minutes_ago * _MINUTE} - ({count} - ({number})) * {_APART})"

    def literal(self, value: Any) -> str:
        """SQL of a Python value."""
        if isinstance(value, bool):
            return str(value).lower() if self._postgresql else str(int(value))
        if isinstance(value, int | float):
            return str(value)
        return f"'{value if isinstance(value, str) else json.dumps(value)}'"

    def fill(self, table: type[Base], rows: int, **columns: str) -> None:
        """Rows 0 to ``rows`` - 1, each column by its SQL of ``n``; columns that are not named hold the usual."""
        usual: dict[str, Any] = {}
        for column in table.__table__.columns:
            default = column.default
            if default is not None and not column.primary_key and default.is_scalar:
                usual[column.name] = default.arg
            elif default is not None and default.is_callable and default.arg.__name__ in ("list", "dict"):
                usual[column.name] = [] if default.arg.__name__ == "list" else {}
        usual |= {table.__mapper__.columns[name].name: value for name, value in USUAL.get(table, {}).items()}
        sql = {name: self.literal(value) for name, value in usual.items()} | columns
        series = (
            f"WITH g(n) AS (SELECT * FROM generate_series(0::bigint, {rows - 1}))"
            if self._postgresql
            else f"WITH RECURSIVE g(n) AS (SELECT 0 UNION ALL SELECT n + 1 FROM g WHERE n < {rows - 1})"
        )
        names = ", ".join(f'"{name}"' for name in sql)
        statement = f"{series} INSERT INTO {table.__tablename__} ({names}) SELECT {', '.join(sql.values())} FROM g"
        self._connection.execute(text(statement.replace(":", "\\:")))


def fill(database: Database, size: Size) -> None:
    """Fill an empty database. On PostgreSQL its statistics are brought up to date, as autovacuum does."""
    with database.engine.execution_options(apexcal_writes=True).begin() as connection:
        clock = (
            "extract(epoch FROM now()) * 1e6"
            if connection.dialect.name == "postgresql"
            else "(julianday('now') - 2440587.5) * 86400e6"
        )
        filler = _Filler(connection, int(connection.scalar(text(f"SELECT CAST({clock} AS BIGINT)")) or 0))
        _fleets(filler, size)
        _calibrations(filler, size)
        _published(filler, size)
        _work(filler, size)
        if size.answered:
            _marking(filler, size)
    if database.engine.dialect.name == "postgresql":
        with database.engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
            connection.execute(text("VACUUM ANALYZE"))


def _fleets(filler: _Filler, size: Size) -> None:
    at = {"created_at": filler.at(10_000_000)}
    filler.fill(models.Person, 3, id=filler.id(2), name="'person ' || n", **at)
    for kind, name in ((1, "busy"), (_QUIET_FLEET, "quiet")):
        filler.fill(models.Fleet, 1, id=filler.id(kind), name=f"'{name}'", **at)
        member = {"person_id": filler.id(2), "fleet_id": filler.id(kind, "0"), "role": "'engineer'"}
        filler.fill(models.Membership, 3, **member, **at)
    common = {"fleet_id": filler.id(1, "0"), **at}
    filler.fill(models.Vehicle, size.vehicles, id=filler.id(3), name="'car ' || n", sort_name="'car ' || n", **common)
    filler.fill(models.Rig, size.vehicles, id=filler.id(4), vehicle_id=filler.id(3), **common)
    filler.fill(models.RigLidar, size.vehicles, id=filler.id(_LIDAR), rig_id=filler.id(4))
    filler.fill(
        models.RigCamera,
        2 * size.vehicles,
        id=filler.id(_CAMERA),
        rig_id=filler.id(4, "n / 2"),
        position="n % 2",
        name="CASE n % 2 WHEN 0 THEN 'front' ELSE 'rear' END",
    )


def _calibrations(filler: _Filler, size: Size) -> None:
    """Each vehicle in turn: a set of one camera, a calibration from it, four runs of that, and their results."""
    count, of_vehicle = size.calibrations, f"n % {size.vehicles}"
    camera = f"CASE (n / {size.vehicles}) % 2 WHEN 0 THEN 'front' ELSE 'rear' END"
    fleet, at = {"fleet_id": filler.id(1, "0")}, filler.at(count=count)
    common = {**fleet, "vehicle_id": filler.id(3, of_vehicle), "rig_id": filler.id(4, of_vehicle), "created_at": at}
    filler.fill(
        models.CorrespondenceSet, count, id=filler.id(_SET), camera=camera, content_hash="'hash ' || n", **common
    )
    asked = {"publish": "'recommended'", "summary": "'{}'", "finished_at": at}
    filler.fill(models.Calibration, count, id=filler.id(_CALIBRATION), **asked, **common)
    one = f"n / {RUNS_OF_A_CALIBRATION}"
    its_camera = camera.replace("(n /", f"(({one}) /")
    at = filler.at(number=one, count=count)
    of_run = {"calibration_id": filler.id(_CALIBRATION, one), "camera": its_camera, "created_at": at}
    of_run |= {"fold": f"n % {RUNS_OF_A_CALIBRATION} - 1", **fleet}
    ended = {"state": "'done'", "iteration": "2", "finished_at": at}
    filler.fill(models.CalibrationRun, size.runs, id=filler.id(_RUN), set_id=filler.id(_SET, one), **ended, **of_run)
    document = {"document": filler.literal(_RESULT_JSON)}
    filler.fill(models.Result, size.runs, id=filler.id(_RESULT), run_id=filler.id(_RUN), **document, **of_run)


def _published(filler: _Filler, size: Size) -> None:
    """Each calibration's first result was published; each round of all vehicles was a fleet request."""
    count, requests = size.calibrations, size.calibrations // size.vehicles
    fleet, vehicle = filler.id(1, "0"), filler.id(3, f"n % {size.vehicles}")
    first = filler.id(_RESULT, f"n * {RUNS_OF_A_CALIBRATION}")
    filler.fill(
        models.Publication,
        count,
        id=filler.id(_PUBLICATION),
        fleet_id=fleet,
        vehicle_id=vehicle,
        camera=f"CASE (n / {size.vehicles}) % 2 WHEN 0 THEN 'front' ELSE 'rear' END",
        number="n + 1",
        result_id=first,
        led_to=first,
        created_at=filler.at(count=count),
    )
    at = filler.at(number=f"n * {size.vehicles}", count=count)
    times = dict.fromkeys(("created_at", "started_at"), at)
    filler.fill(models.FleetRequest, requests, id=filler.id(_REQUEST), fleet_id=fleet, **times)
    filler.fill(
        models.FleetRequestVehicle,
        requests * size.vehicles,
        id=filler.id(_ASKED),
        fleet_request_id=filler.id(_REQUEST, f"n / {size.vehicles}"),
        vehicle_id=vehicle,
        calibration_id=filler.id(_CALIBRATION),
        state="'done'",
        finished_at=filler.at(count=count),
    )


def _work(filler: _Filler, size: Size) -> None:
    """A job for each run, all of one fleet; recordings with their blobs; answers to repeated requests."""
    fleet, at = filler.id(1, "0"), filler.at(number=f"n / {RUNS_OF_A_CALIBRATION}", count=size.calibrations)
    job = {"kind": "'solve'", "attempt": "1", "started_at": at}
    ended = {"id": "n + 1", "fleet_id": fleet, **job, "queue": "'solve'", "subject_id": filler.id(_RUN)}
    ended |= {"state": "'done'", "sends": "1", "send_after": at, "created_at": at, "finished_at": at}
    filler.fill(models.Job, size.runs, **ended)
    # A few are sent and not claimed yet, so that nothing is skipped because there is no work.
    sent = {"id": f"n + {size.runs + 1}", "state": "'queued'", "finished_at": "NULL"}
    filler.fill(models.Job, _SENT_JOBS, **(ended | sent | {"send_after": filler.at(-24 * 60)}))
    told = {"what": "'done'", "at": at, "tallied": filler.literal(True)}
    filler.fill(models.JobEvent, size.runs, id="n + 1", job_id="n + 1", **job, **told)
    count, of_vehicle = size.runs // 20, f"n % {size.vehicles}"
    at = filler.at(count=count)
    filler.fill(
        models.Recording,
        count,
        id=filler.id(_RECORDING),
        fleet_id=fleet,
        vehicle_id=filler.id(3, of_vehicle),
        rig_id=filler.id(4, of_vehicle),
        job_id="n + 1",
        created_at=at,
    )
    filler.fill(models.Blob, 2 * count, key="'blob/' || n", created_at=at)
    key = {"id": filler.id(_KEY), "person_id": filler.id(2, "0"), "key": "'key ' || n", "request_hash": "'hash'"}
    key |= {"status": "202", "body": "'{}'", "created_at": filler.at(number=f"n * 40000 / {count}", count=40_000)}
    filler.fill(models.IdempotencyKey, count, **key)
    if filler._postgresql:
        filler._connection.execute(text(f"SELECT setval('job_id_seq', {size.runs + _SENT_JOBS + 1})"))
        filler._connection.execute(text(f"SELECT setval('job_event_id_seq', {size.runs + 1})"))


def _marking(filler: _Filler, size: Size) -> None:
    """A detection of the first recording: person 0 has answered all its vertices but the last ten."""
    count, at = size.answered + 10, {"created_at": filler.at(100)}
    recording, sensor, detection = (filler.id(kind, "0") for kind in (_RECORDING, _SENSOR, _DETECTION))
    filler.fill(models.Sensor, 1, id=sensor, recording_id=recording, blob_key="'blob/0'", count=str(count))
    filler.fill(
        models.Detection, 1, id=detection, fleet_id=filler.id(1, "0"), recording_id=recording, lidar_id=sensor, **at
    )
    filler.fill(models.Apex, count, id=filler.id(_APEX), recording_id=recording, lidar_id=sensor, sweep_index="n")
    vertex = {"id": filler.id(_VERTEX), "detection_id": detection, "apex_id": filler.id(_APEX), "rank": "n"}
    vertex["lidar_id"] = sensor
    filler.fill(models.Vertex, count, **vertex, sweep_index="n", time_ns="n")
    filler.fill(
        models.VertexFrame, count, vertex_id=filler.id(_VERTEX), sensor_id=sensor, frame_index="n", gap_ns="0"
    )
    filler.fill(models.CameraFrame, count, sensor_id=sensor, index="n", stamp_ns="n")
    mine = {"person_id": filler.id(2, "0"), "sensor_id": sensor, **at}
    said = {"verdict": "'confirmed'", "u": "1.0", "v": "1.0", "frame_index": "n"}
    said |= dict.fromkeys(("is_mark", "is_verdict"), filler.literal(True))
    whose = {"id": filler.id(_ANSWER), "recording_id": recording, "apex_id": filler.id(_APEX)}
    filler.fill(models.Answer, size.answered, **whose, **said, **mine)
    task = {"id": filler.id(_TASK), "detection_id": detection, "vertex_id": filler.id(_VERTEX)}
    times = dict.fromkeys(("leased_until", "answered_at"), at["created_at"])
    filler.fill(models.MarkingTask, size.answered, **task, **times, **mine)


def newest(database: Database, table: str) -> UUID:
    """The id of a table's newest row."""
    with database.engine.connect() as connection:
        found = connection.execute(text(f"SELECT id FROM {table} ORDER BY id DESC LIMIT 1")).scalar_one()
        return found if isinstance(found, UUID) else UUID(hex=found)
