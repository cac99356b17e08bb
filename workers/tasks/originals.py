"""Join the parts of an upload to one file, and limit the process that reads it."""

from __future__ import annotations

import hashlib
import re
import shutil
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from uuid import UUID

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.platform.db.recordings import Recording, Sensor, UploadPart
from service.platform.db.session import repeated
from service.platform.jobs.claims import Lease
from service.platform.settings import MIB, Settings
from service.platform.storage.quota import QuotaExceededError
from workers.readers.limited import Terms
from workers.readers.limits import Limits
from workers.readers.normalised.sensor_files import SweepFile
from workers.readers.recording import ReadError, Sweep
from workers.tasks.context import Context

_REPORT_EVERY = 50


def lidar_key(session: Session, recording_id: UUID | None) -> str:
    """Return the blob key of a recording's LiDAR."""
    return session.scalars(
        select(Sensor.blob_key).where(Sensor.recording_id == recording_id, Sensor.kind == "lidar")
    ).one()


def said_still(session: Session, recording_id: UUID | None) -> bool:
    """Return whether the owner said that a recording holds still poses."""
    return session.get_one(Recording, recording_id).reading.get("point_times") == "stamp_only"


def open_lidar(context: Context, key: str, folder: Path) -> SweepFile:
    """Open the LiDAR of a recording, in the store's folder or as a copy in ``folder``."""
    return SweepFile(context.fetch(key, folder))


def watched(lidar: SweepFile, sweeps: range, lease: Lease, message: str) -> Iterator[Sweep]:
    """Yield the sweeps of a range; report progress and check the lease at each."""
    for number, sweep in enumerate(lidar.sweeps(sweeps.start, sweeps.stop)):
        lease.check()
        if number % _REPORT_EVERY == 0:
            lease.report(number / max(len(sweeps), 1), message)
        yield sweep


def require_room(context: Context, free: int | None, size: int) -> None:
    """Raise :class:`ReadError` ``ingest_disk_full`` if ``size`` bytes would leave less than `min_free_bytes` free."""
    if free is not None and free - size < context.settings.min_free_bytes:
        raise ReadError("ingest_disk_full", f"There is no room for {size} bytes.", "Make room, then try again.")


def store_files(
    context: Context, files: Mapping[str, Path], reserve: Callable[[Mapping[str, int]], Mapping[str, str]]
) -> dict[str, tuple[str, int]]:
    """Put files into the store and return each one's key and size.

    Args:
        reserve: takes sizes by name and returns keys, in a transaction of its own, which may be repeated.

    Raises:
        ReadError: ``fleet_quota_exceeded``, ``ingest_disk_full``.
    """
    sizes = {name: file.stat().st_size for name, file in files.items()}
    require_room(context, context.store.free_bytes(), sum(sizes.values()))
    try:
        keys = repeated(lambda: reserve(sizes))
    except QuotaExceededError as error:
        raise ReadError(error.code, error.message, error.hint, error.fields) from None
    return {name: (key, context.store.put_file(key, files[name])) for name, key in keys.items()}


def camera_of(session: Session, recording_id: UUID | None, name: str) -> Sensor:
    """Return a recording's camera by its name."""
    return session.scalars(select(Sensor).where(Sensor.recording_id == recording_id, Sensor.name == name)).one()


def watching(context: Context, recording: Recording, lease: Lease, message: str) -> Terms:
    """Return the terms under which a child that reads or writes this recording is watched."""
    return {
        "limits": reading_limits(context.settings, recording.size),
        "name": recording.file_name,
        "must_stop": lease.check,
        "on_progress": lambda progress: lease.report(
            0.1 + 0.8 * (progress.share or 0.0), message.format(done=progress.done), progress.seconds_left
        ),
    }


def reading_limits(settings: Settings, size: int) -> Limits:
    """Return the limits of a reading: four fifths of the task's time; the rest is for joining parts and storing."""
    wall_s = settings.ingest_wall_s + settings.ingest_wall_s_per_mib * size / MIB
    return Limits(
        memory_bytes=settings.ingest_memory_bytes,
        cpu_s=settings.ingest_cpu_s,
        wall_s=min(wall_s, 0.8 * settings.task_limit_s),
        silence_s=settings.ingest_silence_s,
        file_bytes=settings.ingest_file_bytes,
        output_ratio=settings.ingest_output_ratio,
        video_ratio=settings.ingest_video_ratio,
        output_floor_bytes=settings.ingest_output_floor_bytes,
        reserve_bytes=settings.min_free_bytes,
    )


def join_parts(context: Context, recording: Recording, folder: Path, lease: Lease) -> Path:
    """Join the parts to the original. The checksums of each part and of the whole must be those acknowledged."""
    source = folder / "original" / plain_name(recording.file_name)
    source.parent.mkdir()
    require_room(context, shutil.disk_usage(folder).free, recording.size)
    of_recording = select(UploadPart).where(UploadPart.recording_id == recording.id)
    with context.database.reading() as session:
        parts = session.scalars(of_recording.order_by(UploadPart.number)).all()
    whole = hashlib.sha256()
    done = 0
    with source.open("wb") as file:
        for part in parts:
            require_room(context, shutil.disk_usage(folder).free, part.size)
            digest = hashlib.sha256()
            for chunk in context.store.stream(part.blob_key):
                file.write(chunk)
                whole.update(chunk)
                digest.update(chunk)
                done += len(chunk)
                lease.report(0.1 * done / max(recording.size, 1), "joining the parts")
            _require_same(f"Part {part.number}", digest.hexdigest(), part.sha256)
    if recording.sha256:
        _require_same("All parts together", whole.hexdigest(), recording.sha256)
    return source


def _require_same(what: str, actual: str, announced: str) -> None:
    """Refuse a part with another checksum. Clients may put parts into the store, which checks no SHA-256."""
    if actual != announced:
        raise ReadError(
            "checksum_mismatch",
            f"{what} has the SHA-256 {actual}, announced was {announced}.",
            "A part was made from another file or another version of it, or damaged on its way. Upload the recording "
            "again.",
        )


def plain_name(file_name: str) -> str:
    """Return the owner's file name if it is harmless. Readers name sensors after it, and look at its suffix."""
    return re.sub(r"[^A-Za-z0-9._-]+", "_", file_name)[-100:].lstrip(".") or "recording"
