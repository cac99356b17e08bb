"""Calibrated copies of a recording, and files of it for viewers."""

from __future__ import annotations

from apexcal.documents.copies import CopyRequest
from service.detections.queries import ready_recording
from service.platform.auth.access import Access
from service.platform.db.analyses import Analysis


def plan(access: Access, request: CopyRequest) -> Analysis:
    """What is written into the copy. Raises :class:`Problem` as ``plan_copy`` and ``plan_viewer_file`` do."""
    # Imported here: it needs NumPy, which takes a twentieth of the start.
    from service.analyses.copy_plan import plan_copy
    from service.analyses.viewer_plan import plan_viewer_file

    recording = ready_recording(access, request.recording_id, "engineer")
    asked = (plan_viewer_file if request.for_viewers else plan_copy)(access.session, recording, request)
    owned = {"fleet_id": recording.fleet_id, "vehicle_id": recording.vehicle_id}
    return Analysis(**owned, recording_id=recording.id, asked=asked)
