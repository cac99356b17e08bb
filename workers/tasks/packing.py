"""A recording's sweeps packed as they go over the wire, so that the service answers with byte ranges."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from uuid import UUID

from sqlalchemy import func, insert, select
from sqlalchemy.orm import Session

from service.platform.db.analyses import Analysis
from service.platform.db.base import Json
from service.platform.db.recordings import PackedSweep, PackedSweeps, Sensor
from service.platform.jobs.claims import Claim, Lease
from service.platform.storage.blobs import keep
from service.platform.storage.quota import recounting
from workers.readers.normalised.lidar_file import LidarFile
from workers.readers.normalised.packed_sweeps import pack
from workers.tasks.analysis_files import store_file
from workers.tasks.context import Context
from workers.tasks.originals import open_lidar, watched


def packing(context: Context, claim: Claim, lease: Lease) -> Callable[[Session], Json]:
    """Pack all sweeps into one file, unless they are packed already."""
    with context.database.reading() as session:
        recording_id = session.get_one(Analysis, claim.subject_id).recording_id
        of_recording = Sensor.recording_id == recording_id
        lidar = session.scalars(select(Sensor).where(of_recording, Sensor.kind == "lidar")).one()
        packed = session.get(PackedSweeps, lidar.id) is not None
    if packed:
        return lambda session: _counts(session, lidar.id)
    with context.scratch() as folder, open_lidar(context, lidar.blob_key, folder) as sweeps:
        file = folder / "sweeps"
        rows = _write(sweeps, file, lease)
        size = file.stat().st_size
        key = store_file(context, claim, file, f"recordings/{recording_id}/sweeps")

    def write(session: Session) -> Json:
        # Of two packings of one recording the first wins, and the sweep removes the other's file.
        with recounting(session, recording_id, besides=claim.job_id):
            if session.get(PackedSweeps, lidar.id) is None:
                keep(session, key, size=size)
                session.add(PackedSweeps(sensor_id=lidar.id, blob_key=key))
                session.flush()
                if rows:
                    session.execute(insert(PackedSweep), [{"sensor_id": lidar.id, **row} for row in rows])
        return _counts(session, lidar.id)

    return write


def _write(sweeps: LidarFile, path: Path, lease: Lease) -> list[Json]:
    """Write the sweeps one after the other. Returns where each one lies."""
    rows: list[Json] = []
    offset = 0
    with path.open("wb") as file:
        for index, sweep in enumerate(watched(sweeps, range(len(sweeps)), lease, "packing sweeps")):
            data = pack(sweep, index, sweeps.ring_count)
            file.write(data)
            extent = {"offset": offset, "length": len(data)}
            rows.append({"index": index, "stamp_ns": sweep.stamp_ns, "points": len(sweep.xyz), **extent})
            offset += len(data)
    return rows


def _counts(session: Session, lidar_id: UUID) -> Json:
    """What is packed, from the rows."""
    columns = func.count(), func.sum(PackedSweep.points), func.sum(PackedSweep.length)
    counts = session.execute(select(*columns).where(PackedSweep.sensor_id == lidar_id)).one()
    return {name: int(count or 0) for name, count in zip(("sweeps", "points", "bytes"), counts, strict=True)}
