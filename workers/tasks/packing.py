"""A recording's sweeps packed as they go over the wire, so that the service answers with byte ranges."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from uuid import UUID

from sqlalchemy import func, insert, select
from sqlalchemy.orm import Session

from service.platform.db.analyses import Analysis
from service.platform.db.base import Json
from service.platform.db.recordings import PackedSweep, PackedSweeps, Recording, Sensor
from service.platform.db.repeating import repeated
from service.platform.jobs.claims import Claim, Lease, require_mine
from service.platform.storage.blobs import keep, reserve
from service.platform.storage.quota import QuotaExceededError, counted, take
from workers.readers.normalised.lidar_file import LidarFile
from workers.readers.normalised.packed_sweeps import pack
from workers.readers.recording import ReadError
from workers.tasks.context import Context
from workers.tasks.loading import open_lidar, require_room, watched


def packing(context: Context, held: Claim, lease: Lease) -> Callable[[Session], None]:
    """Pack all sweeps into one file, unless they are packed already."""
    with context.database.reading() as session:
        recording_id = session.get_one(Analysis, held.subject_id).recording_id
        of_recording = Sensor.recording_id == recording_id
        lidar = session.scalars(select(Sensor).where(of_recording, Sensor.kind == "lidar")).one()
        packed = session.get(PackedSweeps, lidar.id) is not None
    if packed:
        return lambda session: _tell(session, held)
    with context.scratch() as folder, open_lidar(context, lidar.blob_key, folder) as sweeps:
        file = folder / "sweeps"
        rows = _write(sweeps, file, lease)
        size = file.stat().st_size
        key = _store(context, held, recording_id, file, size)

    def write(session: Session) -> None:
        # Of two packings of one recording the first wins, and the sweep removes the other's file.
        recording = session.get_one(Recording, recording_id, with_for_update=True)
        if session.get(PackedSweeps, lidar.id) is None:
            keep(session, key, size=size)
            session.add(PackedSweeps(sensor_id=lidar.id, blob_key=key))
            session.flush()
            if rows:
                session.execute(insert(PackedSweep), [{"sensor_id": lidar.id, **row} for row in rows])
        session.flush()
        recording.taken_bytes = counted(session, recording, besides=held.job_id)
        _tell(session, held)

    return write


def _write(sweeps: LidarFile, path: Path, lease: Lease) -> list[Json]:
    """Write the sweeps one after the other. Returns where each one lies."""
    rows: list[Json] = []
    offset = 0
    with path.open("wb") as file:
        for index, sweep in enumerate(watched(sweeps, range(len(sweeps)), lease, "packing sweeps")):
            data = pack(sweep, index, sweeps.ring_count)
            file.write(data)
            place = {"offset": offset, "length": len(data)}
            rows.append({"index": index, "stamp_ns": sweep.stamp_ns, "points": len(sweep.xyz), **place})
            offset += len(data)
    return rows


def _store(context: Context, held: Claim, recording_id: UUID, file: Path, size: int) -> str:
    """Put the file into the store, and return its key.

    Raises :class:`ReadError` ``fleet_quota_exceeded``, ``ingest_disk_full``.
    """
    require_room(context, context.store.free_bytes(), size)
    try:
        key = repeated(lambda: _reserve(context, held, recording_id, size))
    except QuotaExceededError as error:
        raise ReadError(error.code, error.message, error.hint, error.fields) from None
    context.store.put_file(key, file)
    return key


def _reserve(context: Context, held: Claim, recording_id: UUID, size: int) -> str:
    """A key, if the fleet has room: what is reserved counts, so that several jobs do not exceed it together."""
    with context.database.writing() as session:
        require_mine(session, held)
        recording = session.get_one(Recording, recording_id, with_for_update=True)
        taken = counted(session, recording, besides=held.job_id) + size
        take(session, recording, taken, context.settings.fleet_quota_bytes)
        prefix = f"recordings/{recording_id}/sweeps"
        return reserve(session, prefix, size=size, job_id=held.job_id, attempt=held.attempt)


def _tell(session: Session, held: Claim) -> None:
    """Sets the analysis's result from the rows."""
    analysis = session.get_one(Analysis, held.subject_id)
    count, points, size = session.execute(
        select(
            func.count(),
            func.coalesce(func.sum(PackedSweep.points), 0),
            func.coalesce(func.sum(PackedSweep.length), 0),
        )
        .join(Sensor, Sensor.id == PackedSweep.sensor_id)
        .where(Sensor.recording_id == analysis.recording_id)
    ).one()
    analysis.result = {"sweeps": count, "points": int(points), "bytes": int(size)}
