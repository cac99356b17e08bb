"""A detection's row."""

from __future__ import annotations

from uuid import UUID

from apexcal.documents.detections import DetectionRequest
from apexcal.documents.detectors import resolve_options
from apexcal.documents.states import WorkState
from service.db.detections import Detection
from service.db.digests import content_hash
from service.db.recordings import Recording


def new_detection(recording: Recording, wanted: DetectionRequest, person_id: UUID) -> Detection:
    """The row of a detection, all its options resolved. Raises DocumentError as ``resolve_options`` does."""
    options = resolve_options(wanted.detector, wanted.options)
    pairing = wanted.pairing.model_dump()
    content = {"region": wanted.region, "detector": wanted.detector, "options": options, "pairing": pairing}
    return Detection(
        fleet_id=recording.fleet_id,
        recording_id=recording.id,
        **content,
        content_hash=content_hash({"recording": recording.sha256 or recording.id.hex, **content}),
        state=WorkState.QUEUED,
        remaining=1,
        counts={},
        created_by=person_id,
    )
