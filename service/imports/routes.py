"""Calibrations of other programs: what their files hold, and how a result compares with them. Nothing is stored."""

from __future__ import annotations

from uuid import UUID

from apexcal.documents.imports import CalibrationFiles, ComparisonRequest, ReadFiles, StatedComparison
from apexcal.documents.rig_proposals import ProposalRequest, RigProposal
from service.platform.auth.access import ReadAccess
from service.platform.db.calibrations import Result
from service.platform.db.recordings import Recording
from service.platform.http.processes import in_process
from service.platform.http.router import DOCUMENT, Router

router = Router(tags=["imports"])


@router.post("/calibration-files/reading")
def read_calibration_files(body: CalibrationFiles, access: ReadAccess) -> ReadFiles:
    """Lenses and mounts in files of ROS, OpenCV, Kalibr or KITTI, with what is implausible of them."""
    # Imported here, as below: it needs NumPy and YAML, which take a twentieth of the start.
    from service.imports.formats import files_view

    return in_process(files_view, body)


@router.post("/results/{result_id}/comparison")
def compare_with_stated(result_id: UUID, body: ComparisonRequest, access: ReadAccess) -> StatedComparison:
    """How far a result is from a mount or lens that is known otherwise, and if that one is read the wrong way."""
    from service.imports.comparing import stated_comparison

    result = access.find(Result, result_id)
    return in_process(stated_comparison, body, result.published)


@router.post("/recordings/{recording_id}/rig-proposals", max_body_size=DOCUMENT)
def propose_rig_of_recording(recording_id: UUID, body: ProposalRequest, access: ReadAccess) -> RigProposal:
    """A rig from a recording's sensors and fixed frames, from a URDF, and from what a person answers."""
    from service.imports.proposing import proposed, read_frames

    frames = read_frames(access.session, access.find(Recording, recording_id))
    return in_process(proposed, frames, body)
