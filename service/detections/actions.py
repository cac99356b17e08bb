"""A detection's row."""

from __future__ import annotations

from uuid import UUID

from apexcal.documents.detections import DetectionRequest
from apexcal.documents.detectors import resolve_options
from apexcal.documents.states import WorkState
from service.platform.db.detections import Detection
from service.platform.db.digests import content_hash
from service.platform.db.fleets import Rig
from service.platform.db.recordings import Recording

_UP = ("up_x", "up_y", "up_z")


def new_detection(recording: Recording, rig: Rig, wanted: DetectionRequest, person_id: UUID) -> Detection:
    """The row of a detection, all its options resolved. Raises DocumentError as ``resolve_options`` does.

    Up is as the request says, else as the rig's ``T_vehicle_lidar`` does: the vehicle's z.
    """
    options = resolve_options(wanted.detector, wanted.options)
    if rig.T_vehicle_lidar is not None and all(options.get(name) == 0.0 for name in _UP):
        # Imported here: it needs NumPy, which takes a twentieth of the service's start.
        from apexcal.geometry.se3 import from_document

        up = from_document(rig.T_vehicle_lidar).R[2].round(6).tolist()
        options |= dict(zip(_UP, up, strict=True))
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
