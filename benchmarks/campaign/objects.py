"""The store beside its rows: every object has a row that uses it, and every row that is in use has its object."""

from __future__ import annotations

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.platform.db.models import AnalysisFile, Blob, Sensor, UploadPart


def used_keys(session: Session) -> set[str]:
    """The keys that parts, sensors, packed sweeps and calibrated copies name."""
    columns = (UploadPart.blob_key, Sensor.blob_key, AnalysisFile.blob_key)
    return {key for column in columns for key in session.scalars(select(column))}


def check_objects(session: Session, present: set[str]) -> list[str]:
    """Objects that no row uses, and rows that nothing uses and nothing will ever remove."""
    blobs = {row.key: row for row in session.scalars(select(Blob))}
    used = used_keys(session)
    found = [f"the object {key} has no row" for key in sorted(present - set(blobs))]
    for key, row in sorted(blobs.items()):
        if row.state != "stored":
            found.append(f"the blob {key} is left {row.state} (job {row.job_id}, attempt {row.attempt})")
        elif key not in used:
            found.append(f"the blob {key} is stored, and nothing uses it")
    return found


def missing_objects(session: Session, present: set[str]) -> list[str]:
    """Rows in use whose object is gone, or that the sweep is about to remove."""
    states = dict(session.execute(select(Blob.key, Blob.state)).all())
    used = used_keys(session)
    found = [f"the object {key} is in use and not there" for key in sorted(used - present)]
    return found + [
        f"the blob {key} is in use and {states.get(key)}" for key in sorted(used) if states.get(key) != "stored"
    ]
