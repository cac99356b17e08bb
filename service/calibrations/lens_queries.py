"""The intrinsics that a recording states of its cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from sqlalchemy import select
from sqlalchemy.orm import Session

from apexcal.documents.calibrations import CalibrationTemplate
from apexcal.documents.lenses import lens_of_images
from apexcal.documents.readings import ImageKind
from service.calibrations.cameras import CameraPairs
from service.calibrations.lenses import check_size
from service.db.base import Json
from service.db.calibrations import CorrespondenceSet
from service.db.fleets import RigCamera
from service.db.recordings import Sensor
from service.http.problems import Problem


def with_recorded_lenses(
    session: Session, wanted: CalibrationTemplate, sources: Sequence[CameraPairs]
) -> Sequence[CameraPairs]:
    """The cameras with the lenses that their recordings state, where the request starts from these.

    A lens that the request itself gives goes before.

    Raises:
        Problem: 422 ``no_intrinsics_stated`` or ``intrinsics_of_another_size``.
    """
    if wanted.intrinsics_from != "recording":
        return sources
    return [
        source
        if source.camera.name in wanted.intrinsics
        else replace(source, stated=_stated_intrinsics(session, source.camera, source.pairs))
        for source in sources
    ]


def _stated_intrinsics(session: Session, camera: RigCamera, pairs: CorrespondenceSet) -> Json:
    """What the recording of these pairs says of the camera (CameraInfo)."""
    found = select(Sensor.facts).where(Sensor.recording_id == pairs.recording_id, Sensor.name == camera.name)
    facts = session.scalar(found) or {}
    kind: ImageKind | None = camera.images["kind"] if camera.images else facts.get("image_kind")
    stated = facts.get("camera_info") and lens_of_images(facts["camera_info"], kind)
    if stated is None:
        which = "P of rectified images" if kind == "rectified" else "its intrinsics"
        raise Problem(
            422,
            "no_intrinsics_stated",
            f"The pairs of {camera.name} come from no recording that states {which}.",
            "Do not ask for the recording's (intrinsics_from: recording; --stated), or give the lens as intrinsics.",
        )
    check_size(stated, camera, f"The recording states intrinsics of {camera.name}")
    return stated
