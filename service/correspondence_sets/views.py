"""Correspondence sets without their pairs, as the answers show them."""

from __future__ import annotations

from apexcal.documents.correspondence_sets import SetView
from service.db.calibrations import CorrespondenceSet


def set_view(row: CorrespondenceSet) -> SetView:
    """A set without its pairs."""
    return SetView(
        id=row.id,
        fleet_id=row.fleet_id,
        vehicle_id=row.vehicle_id,
        rig_id=row.rig_id,
        recording_id=row.recording_id,
        detection_id=row.detection_id,
        camera=row.camera,
        source="import" if row.source == "import" else "annotations",
        count=row.count,
        content_hash=row.content_hash,
        notes=row.notes,
        flagged=row.flagged,
        created_at=row.created_at,
    )
