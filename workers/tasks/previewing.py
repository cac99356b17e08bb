"""How much of a recording a region keeps."""

from __future__ import annotations

from collections.abc import Callable

from sqlalchemy.orm import Session

from service.db.detections import RegionPreview
from service.jobs.claims import Claim, Lease
from workers.tasks.context import Context
from workers.tasks.loading import lidar_key, open_lidar, watched
from workers.vertices.preview import preview as count_kept
from workers.vertices.region import Region


def preview(context: Context, held: Claim, lease: Lease) -> Callable[[Session], None]:
    """Count frames and points inside the region, per ring."""
    with context.database.reading() as session:
        asked = session.get_one(RegionPreview, held.subject_id)
        key = lidar_key(session, asked.recording_id)
    with context.scratch() as folder, open_lidar(context, key, folder) as lidar:
        counts = count_kept(
            watched(lidar, range(len(lidar)), lease, "counting points"), Region.from_document(asked.region)
        )

    def write(session: Session) -> None:
        session.get_one(RegionPreview, held.subject_id).result = dict(counts)

    return write
