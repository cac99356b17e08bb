"""Calibrated copies of a recording, and files of it for viewers."""

from __future__ import annotations

from apexcal.documents.base import stored
from apexcal.documents.copies import CopyRequest, CopyView
from service.analyses.plan import Plan
from service.platform.auth.access import Access
from service.platform.db.analyses import Analysis
from service.platform.db.base import Json
from service.platform.db.recordings import Recording


def plan(access: Access, recording: Recording, request: CopyRequest) -> Plan:
    """What is written into the copy. Raises :class:`Problem` as ``plan_copy`` and ``plan_viewer_file`` do."""
    # Imported here: it needs NumPy, which takes a twentieth of the start.
    from service.analyses.copy_plan import plan_copy
    from service.analyses.viewer_plan import plan_viewer_file

    return Plan((plan_viewer_file if request.for_viewers else plan_copy)(access.session, recording, request))


def view(row: Analysis, members: Json) -> CopyView:
    """A copy as answers show it."""
    return CopyView(
        **members,
        results=row.asked["results"],
        poses=stored(row.asked["poses"]),
        for_viewers=row.asked.get("for_viewers", False),
    )
