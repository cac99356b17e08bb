"""Calibrations of other programs: what their files hold, and how a result compares with them. Nothing is stored."""

from __future__ import annotations

from uuid import UUID

from apexcal.documents.imports import (
    CalibrationFiles,
    ComparisonRequest,
    DraftRequest,
    ReadFiles,
    RigDraft,
    StatedComparison,
    UrdfDraftRequest,
)
from service.platform.auth.access import CurrentIdentity, ReadAccess
from service.platform.db.calibrations import Result
from service.platform.db.recordings import Recording
from service.platform.http.bodies import DOCUMENT
from service.platform.http.problems import Problem
from service.platform.http.router import Router

router = Router(tags=["imports"])


@router.post("/calibration-files/reading")
def read_calibration_files(body: CalibrationFiles, identity: CurrentIdentity) -> ReadFiles:
    """Lenses and mounts in files of ROS, OpenCV, Kalibr or KITTI, with what is implausible of them."""
    # Imported here, as below: it needs NumPy and YAML, which take a twentieth of the start.
    from service.imports.formats import files_view

    return files_view(body)


@router.post("/results/{result_id}/comparison")
def compare_with_stated(result_id: UUID, body: ComparisonRequest, access: ReadAccess) -> StatedComparison:
    """How far a result is from a mount or lens that is known otherwise, and if that one is read the wrong way."""
    from service.imports.comparing import stated_comparison

    result = access.find(Result, result_id)
    return stated_comparison(body, result.fit, result.spread)


@router.post("/rig-drafts", max_body_size=DOCUMENT)
def draft_rig(body: UrdfDraftRequest, identity: CurrentIdentity) -> RigDraft:
    """A rig from a URDF file: nominal mounts, frames, and the joint that each camera's results are given for."""
    from service.imports.drafting import draft, urdf_tree

    return draft(body, urdf_tree(body.urdf.encode()))


@router.post("/recordings/{recording_id}/rig-drafts", operation_id="recordings.create_rig_draft")
def draft_rig_of_recording(recording_id: UUID, body: DraftRequest, access: ReadAccess) -> RigDraft:
    """A rig from the transforms that a recording states once and for all (`/tf_static`)."""
    from service.imports.drafting import draft, recorded_tree

    recording = access.find(Recording, recording_id)
    transforms = (recording.facts or {}).get("static_transforms")
    if not transforms:
        raise Problem(
            409,
            "no_static_transforms",
            f"The recording {recording.name!r} holds no /tf_static.",
            "Send the vehicle's URDF, or upload the recording again.",
        )
    return draft(body, recorded_tree(transforms))
