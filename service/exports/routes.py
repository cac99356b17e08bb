"""The table of export formats, and a sent URDF with one joint as calibrated."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any
from uuid import UUID

from fastapi.responses import Response

from apexcal.documents.exports import FormatView, UrdfRequest
from service.exports.answers import notes_header, table
from service.exports.queries import of_result
from service.platform.auth.access import CurrentIdentity, ReadAccess
from service.platform.db.calibrations import Result
from service.platform.http.router import DOCUMENT, Router

if TYPE_CHECKING:
    from service.exports.calibrated import Calibrated

router = Router(tags=["exports"])

_TEXT = {"schema": {"type": "string"}}
XML: dict[int | str, dict[str, Any]] = {200: {"content": {"application/xml": _TEXT, "application/yaml": _TEXT}}}


@router.get("/export-formats", response_model=list[FormatView])
def list_formats(identity: CurrentIdentity) -> list[dict[str, object]]:
    """The formats in which calibrations are answered (``?format=NAME``), and what each of them carries."""
    return table()


@router.post("/results/{result_id}/urdf", max_body_size=DOCUMENT, response_class=Response, responses=XML)
def patch_urdf_of_result(result_id: UUID, body: UrdfRequest, access: ReadAccess) -> Response:
    """The sent URDF with one joint's origin as a result has it; all other bytes stay. Nothing is stored."""
    return patched_answer(body, of_result(access.session, access.find(Result, result_id).id))


def patched_answer(body: UrdfRequest, calibrated: Calibrated) -> Response:
    """The sent file with the mount of the one camera of ``calibrated``."""
    # Imported here: they need NumPy, which takes a twentieth of the start.
    from service.exports import autoware_patch
    from service.exports.urdf_patch import patched

    camera = calibrated.cameras[0].alone()
    if not body.urdf.lstrip("\ufeff \t\r\n").startswith("<"):
        text = autoware_patch.patched(body.urdf, body.joint, camera)
        return Response(text, media_type="application/yaml", headers=notes_header([camera.needs()]))
    # The file has the camera's own frame, or names that of the rectified images.
    mount = camera.T_camera_lidar if body.camera_link == camera.frame else camera.T_own_lidar
    mount = replace(
        mount, to_frame=body.camera_link or mount.to_frame, from_frame=body.lidar_link or mount.from_frame
    )
    document = patched(body.urdf.encode(), body.joint, mount)
    return Response(document, media_type="application/xml", headers=notes_header([camera.needs()]))
