"""What detection and preview both need first: a ready recording's LiDAR, opened."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from uuid import UUID

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.platform.db.recordings import Recording, Sensor
from service.platform.jobs.claims import Lease
from workers.readers.normalised.lidar_file import LidarFile
from workers.readers.recording import ReadError, Sweep
from workers.tasks.context import Context

_REPORT_EVERY = 50


def lidar_key(session: Session, recording_id: UUID | None) -> str:
    """Blob key of a recording's LiDAR."""
    return session.scalars(
        select(Sensor.blob_key).where(Sensor.recording_id == recording_id, Sensor.kind == "lidar")
    ).one()


def said_still(session: Session, recording_id: UUID | None) -> bool:
    """Whether the owner said that a recording holds still poses."""
    return session.get_one(Recording, recording_id).reading.get("point_times") == "stamp_only"


def open_lidar(context: Context, key: str, folder: Path) -> LidarFile:
    """The LiDAR of a recording, from the store's folder or a copy in ``folder``."""
    return LidarFile(context.fetch(key, folder))


def watched(lidar: LidarFile, sweeps: range, lease: Lease, message: str) -> Iterator[Sweep]:
    """The sweeps of a range, with progress reported and the lease looked at along the way."""
    for number, sweep in enumerate(lidar.sweeps(sweeps.start, sweeps.stop)):
        lease.check()
        if number % _REPORT_EVERY == 0:
            lease.report(number / max(len(sweeps), 1), message)
        yield sweep


def require_room(context: Context, free: int | None, size: int) -> None:
    """Raises :class:`ReadError` ``ingest_disk_full`` where so many bytes would leave less free than is kept free."""
    if free is not None and free - size < context.settings.min_free_bytes:
        raise ReadError("ingest_disk_full", f"There is no room for {size} bytes.", "Make room, then try again.")
