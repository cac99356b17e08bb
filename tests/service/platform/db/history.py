"""A database with a long history: as many ended runs as wanted with all that belongs to them, a statement a table.

Ids are numbers written as UUIDs, so rows of one number belong together and sort by it, as by the time.
"""

from __future__ import annotations

from dataclasses import dataclass
from uuid import UUID

from sqlalchemy import Connection, text

from service.platform.db.session import Database

# Rows of one kind begin here, so that no two tables share an id.
FLEET, PERSON, VEHICLE, RIG = (UUID(int=kind << 96) for kind in range(1, 5))
_CAMERA, _SET, _CALIBRATION, _RUN, _RESULT, _PUBLICATION, _REQUEST, _ASKED, _OTHER = range(5, 14)
_RECORDING, _SENSOR, _DETECTION, _APEX, _VERTEX, _ANSWER, _TASK, _KEY, _QUIET_FLEET = range(14, 23)

QUIET_FLEET = UUID(int=_QUIET_FLEET << 96)
RECORDING, CAMERA, DETECTION = (UUID(int=kind << 96) for kind in (_RECORDING, _SENSOR, _DETECTION))
RUNS_OF_A_CALIBRATION = 4
# Microseconds: the newest row is some minutes old, a million runs are of 58 days.
_MINUTE = 60_000_000
_APART = 20_000_000
_SENT_JOBS = 20
_NOT_NULL_JSON = "'{}'"
# What a vehicle's document takes from a result.
_RESULT_JSON = """'{"intrinsics": {}, "transform": {}, "polished": {"mean_px": 1.0, "rms_px": 1.0}}'"""


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

    def bool(self, value: bool) -> str:
        return str(value).lower() if self._postgresql else str(int(value))

    def fill(self, table: str, count: int, columns: dict[str, str]) -> None:
        """Rows 0 to ``count`` - 1, each column by its SQL of ``n``."""
        series = (
            f"WITH g(n) AS (SELECT * FROM generate_series(0::bigint, {count - 1}))"
            if self._postgresql
            else f"WITH RECURSIVE g(n) AS (SELECT 0 UNION ALL SELECT n + 1 FROM g WHERE n < {count - 1})"
        )
        names = ", ".join(f'"{name}"' for name in columns)
        self._connection.execute(
            text(
                f"{series} INSERT INTO {table} ({names}) SELECT {', '.join(columns.values())} FROM g".replace(
                    ":", "\\:"
                )
            )
        )


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
    at = filler.at(10_000_000)
    for kind, name in ((1, "busy"), (_QUIET_FLEET, "quiet")):
        filler.fill("fleet", 1, {"id": filler.id(kind), "name": f"'{name}'", "version": "1", "created_at": at})
    filler.fill(
        "person",
        3,
        {"id": filler.id(2), "name": "'person ' || n", "is_owner": filler.bool(False), "created_at": at},
    )
    for fleet in (1, _QUIET_FLEET):
        member = {
            "person_id": filler.id(2),
            "fleet_id": filler.id(fleet, "0"),
            "role": "'engineer'",
            "created_at": at,
        }
        filler.fill("membership", 3, member)
    common = {"fleet_id": filler.id(1, "0"), "version": "1", "created_at": at}
    filler.fill("vehicle", size.vehicles, {"id": filler.id(3), "name": "'car ' || n", **common})
    rig = {"id": filler.id(4), "vehicle_id": filler.id(3), "name": "'roof'", "lidar_frame": "'velodyne'", **common}
    filler.fill("rig", size.vehicles, rig)
    filler.fill(
        "rig_camera",
        2 * size.vehicles,
        {
            "id": filler.id(_CAMERA),
            "rig_id": filler.id(4, "n / 2"),
            "position": "n % 2",
            "name": "CASE n % 2 WHEN 0 THEN 'front' ELSE 'rear' END",
            "frame": "'optical'",
            "image_width": "640",
            "image_height": "480",
            "nominal": _NOT_NULL_JSON,
            "bounds": _NOT_NULL_JSON,
        },
    )


def _calibrations(filler: _Filler, size: Size) -> None:
    """Each vehicle in turn: a set of one camera, a calibration from it, four runs of that, and their results."""
    count, of_vehicle = size.calibrations, f"n % {size.vehicles}"
    camera = f"CASE (n / {size.vehicles}) % 2 WHEN 0 THEN 'front' ELSE 'rear' END"
    common = {
        "fleet_id": filler.id(1, "0"),
        "vehicle_id": filler.id(3, of_vehicle),
        "rig_id": filler.id(4, of_vehicle),
    }
    at = filler.at(count=count)
    filler.fill(
        "correspondence_set",
        count,
        {
            "id": filler.id(_SET),
            **common,
            "camera": camera,
            "source": "'import'",
            "content_hash": "'hash ' || n",
            "count": "0",
            "pairs": _NOT_NULL_JSON,
            "flagged": "0",
            "notes": "'[]'",
            "created_at": at,
        },
    )
    filler.fill(
        "calibration",
        count,
        {
            "id": filler.id(_CALIBRATION),
            **common,
            "request": _NOT_NULL_JSON,
            "content_hash": "'hash'",
            "state": "'done'",
            "remaining": "0",
            "publish": "'recommended'",
            "notes": "'[]'",
            "summary": _NOT_NULL_JSON,
            "created_at": at,
            "finished_at": at,
        },
    )
    one = f"n / {RUNS_OF_A_CALIBRATION}"
    its_camera = camera.replace("(n /", f"(({one}) /")
    of_run = {
        "fleet_id": filler.id(1, "0"),
        "calibration_id": filler.id(_CALIBRATION, one),
        "camera": its_camera,
        "model": "'pinhole'",
        "fold": f"n % {RUNS_OF_A_CALIBRATION} - 1",
    }
    at = filler.at(number=one, count=count)
    filler.fill(
        "calibration_run",
        size.runs,
        {
            "id": filler.id(_RUN),
            **of_run,
            "set_id": filler.id(_SET, one),
            "farm": "'runs'",
            "slots": "2",
            "bundle": "2",
            "problem": _NOT_NULL_JSON,
            "state": "'done'",
            "iteration": "2",
            "remaining": "0",
            "cancel_requested": filler.bool(False),
            "created_at": at,
            "finished_at": at,
        },
    )
    document = {"document": _RESULT_JSON, "created_at": at}
    filler.fill("result", size.runs, {"id": filler.id(_RESULT), **of_run, "run_id": filler.id(_RUN), **document})


def _published(filler: _Filler, size: Size) -> None:
    """Each calibration's first result was published; each round of all vehicles was a fleet request."""
    count, of_vehicle = size.calibrations, f"n % {size.vehicles}"
    camera = f"CASE (n / {size.vehicles}) % 2 WHEN 0 THEN 'front' ELSE 'rear' END"
    filler.fill(
        "publication",
        count,
        {
            "id": filler.id(_PUBLICATION),
            "fleet_id": filler.id(1, "0"),
            "vehicle_id": filler.id(3, of_vehicle),
            "camera": camera,
            "alias": "'current'",
            "number": "n + 1",
            "result_id": filler.id(_RESULT, f"n * {RUNS_OF_A_CALIBRATION}"),
            "led_to": filler.id(_RESULT, f"n * {RUNS_OF_A_CALIBRATION}"),
            "created_at": filler.at(count=count),
        },
    )
    requests = count // size.vehicles
    at = filler.at(number=f"n * {size.vehicles}", count=count)
    counts = {"done": str(size.vehicles), "failed": "0", "cancelled": "0", "skipped": "0", "wave": str(size.vehicles)}
    filler.fill(
        "fleet_request",
        requests,
        {
            "id": filler.id(_REQUEST),
            "fleet_id": filler.id(1, "0"),
            "asked": '\'{"vehicles": {}, "calibration": {"publish": "recommended"}}\'',
            "state": "'done'",
            "matched": str(size.vehicles),
            "remaining": "0",
            **counts,
            "cancel_requested": filler.bool(False),
            "created_at": at,
            "started_at": at,
            "finished_at": at,
        },
    )
    filler.fill(
        "fleet_request_vehicle",
        requests * size.vehicles,
        {
            "id": filler.id(_ASKED),
            "fleet_request_id": filler.id(_REQUEST, f"n / {size.vehicles}"),
            "vehicle_id": filler.id(3, of_vehicle),
            "calibration_id": filler.id(_CALIBRATION),
            "state": "'done'",
            "finished_at": filler.at(count=count),
        },
    )


def _work(filler: _Filler, size: Size) -> None:
    """A job for each run, all of one fleet; recordings with their blobs; answers to repeated requests."""
    at = filler.at(number=f"n / {RUNS_OF_A_CALIBRATION}", count=size.calibrations)
    job = {"kind": "'solve'", "attempt": "1", "started_at": at}
    ended = {
        "id": "n + 1",
        "fleet_id": filler.id(1, "0"),
        **job,
        "queue": "'solve'",
        "subject_id": filler.id(_RUN),
        "payload": _NOT_NULL_JSON,
        "state": "'done'",
        "lost": "0",
        "sends": "1",
        "send_after": at,
        "cancel_requested": filler.bool(False),
        "created_at": at,
        "finished_at": at,
    }
    filler.fill("job", size.runs, ended)
    # A few are sent and not claimed yet, so that nothing is skipped because there is no work.
    tomorrow = filler.at(-24 * 60)
    sent = {"id": f"n + {size.runs + 1}", "state": "'queued'", "send_after": tomorrow, "finished_at": "NULL"}
    filler.fill("job", _SENT_JOBS, ended | sent)
    told = {"what": "'done'", "at": at, "tallied": filler.bool(True)}
    filler.fill("job_event", size.runs, {"id": "n + 1", "job_id": "n + 1", **job, **told})
    count = size.runs // 20
    at, of_vehicle = filler.at(count=count), f"n % {size.vehicles}"
    filler.fill(
        "recording",
        count,
        {
            "id": filler.id(_RECORDING),
            "fleet_id": filler.id(1, "0"),
            "vehicle_id": filler.id(3, of_vehicle),
            "rig_id": filler.id(4, of_vehicle),
            "name": "'walk'",
            "file_name": "'walk.bag'",
            "state": "'ready'",
            "size": "1",
            "marks_per_vertex": "1",
            "reading": _NOT_NULL_JSON,
            "taken_bytes": "1",
            "warnings": "'[]'",
            "job_id": "n + 1",
            "version": "1",
            "created_at": at,
        },
    )
    blob = {"key": "'blob/' || n", "state": "'stored'", "size": "1", "failed_removals": "0", "created_at": at}
    filler.fill("blob", 2 * count, blob)
    filler.fill(
        "idempotency_key",
        count,
        {
            "id": filler.id(_KEY),
            "person_id": filler.id(2, "0"),
            "key": "'key ' || n",
            "request_hash": "'hash'",
            "status": "202",
            "body": _NOT_NULL_JSON,
            "created_at": filler.at(number=f"n * 40000 / {count}", count=40_000),
        },
    )
    if filler._postgresql:
        filler._connection.execute(text(f"SELECT setval('job_id_seq', {size.runs + _SENT_JOBS + 1})"))
        filler._connection.execute(text(f"SELECT setval('job_event_id_seq', {size.runs + 1})"))


def _marking(filler: _Filler, size: Size) -> None:
    """A detection of the first recording: person 0 has answered all its vertices but the last ten."""
    count, at = size.answered + 10, filler.at(100)
    filler.fill(
        "sensor",
        1,
        {
            "id": filler.id(_SENSOR),
            "recording_id": filler.id(_RECORDING),
            "kind": "'camera'",
            "name": "'front'",
            "topic": "'/front'",
            "frame_id": "'front'",
            "blob_key": "'blob/0'",
            "count": str(count),
            "first_ns": "0",
            "last_ns": "0",
            "facts": _NOT_NULL_JSON,
        },
    )
    filler.fill(
        "detection",
        1,
        {
            "id": filler.id(_DETECTION),
            "fleet_id": filler.id(1, "0"),
            "recording_id": filler.id(_RECORDING),
            "region": _NOT_NULL_JSON,
            "detector": "'tolerant'",
            "options": _NOT_NULL_JSON,
            "pairing": _NOT_NULL_JSON,
            "content_hash": "'hash'",
            "state": "'done'",
            "remaining": "0",
            "counts": _NOT_NULL_JSON,
            "created_at": at,
        },
    )
    tip = {"corner": "'top'"}
    sweep = {"sweep_index": "n", "x": "1.0", "y": "1.0", "z": "1.0", **tip}
    filler.fill("apex", count, {"id": filler.id(_APEX), "recording_id": filler.id(_RECORDING, "0"), **sweep})
    filler.fill(
        "vertex",
        count,
        {
            "id": filler.id(_VERTEX),
            "detection_id": filler.id(_DETECTION, "0"),
            "apex_id": filler.id(_APEX),
            "rank": "n",
            "time_ns": "n",
            **sweep,
            "ring": "0",
            "points": "10",
            "flags": "'[]'",
        },
    )
    frame = {"frame_index": "n", "gap_ns": "0"}
    camera = {"sensor_id": filler.id(_SENSOR, "0")}
    filler.fill("vertex_frame", count, {"vertex_id": filler.id(_VERTEX), **camera, **frame})
    filler.fill(
        "camera_frame",
        count,
        {
            **camera,
            "index": "n",
            "stamp_ns": "n",
            "offset": "0",
            "length": "1",
            "media_type": "'image/png'",
            "width": "640",
            "height": "480",
        },
    )
    mine = {"person_id": filler.id(2, "0")}
    filler.fill(
        "answer",
        size.answered,
        {
            "id": filler.id(_ANSWER),
            "recording_id": filler.id(_RECORDING, "0"),
            "apex_id": filler.id(_APEX),
            **camera,
            **mine,
            **tip,
            "frame_index": "n",
            "verdict": "'confirmed'",
            "u": "1.0",
            "v": "1.0",
            "reviewed": filler.bool(False),
            "is_mark": filler.bool(True),
            "is_verdict": filler.bool(True),
            "version": "1",
            "created_at": at,
        },
    )
    filler.fill(
        "marking_task",
        size.answered,
        {
            "id": filler.id(_TASK),
            "detection_id": filler.id(_DETECTION, "0"),
            "vertex_id": filler.id(_VERTEX),
            **camera,
            **mine,
            "leased_until": at,
            "answered_at": at,
            "created_at": at,
        },
    )


def newest(database: Database, table: str) -> UUID:
    """The id of a table's newest row."""
    with database.engine.connect() as connection:
        found = connection.execute(text(f"SELECT id FROM {table} ORDER BY id DESC LIMIT 1")).scalar_one()
        return found if isinstance(found, UUID) else UUID(hex=found)
