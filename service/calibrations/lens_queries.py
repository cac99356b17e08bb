"""The intrinsics that a recording states of its cameras, or that a person stated of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from sqlalchemy import select
from sqlalchemy.orm import Session

from apexcal.documents.calibrations import CalibrationTemplate, CameraLens
from apexcal.documents.lenses import lens_of_images
from apexcal.documents.readings import ImageKind
from service.calibrations.lenses import as_stated, check_size, is_of_images
from service.calibrations.resolve import CameraPairs
from service.fleets.rigs import rig_camera
from service.platform.db.base import Json
from service.platform.db.calibrations import CorrespondenceSet
from service.platform.db.fleets import Rig, RigCamera
from service.platform.db.recordings import Recording, Sensor
from service.platform.http.problems import not_found, unprocessable


def with_recorded_lenses(
    session: Session, template: CalibrationTemplate, sources: Sequence[CameraPairs]
) -> Sequence[CameraPairs]:
    """The cameras with the lenses that their recordings state, where the request does not ignore these.

    A lens that the request itself gives goes before. One of other images is refused only where the request insists.

    Raises:
        Problem: 422 ``no_intrinsics_stated`` or ``intrinsics_of_another_size``.
    """
    if template.intrinsics_from == "bounds":
        return sources
    insists = template.intrinsics_from == "recording" or template.intrinsics_as == "locked"
    return [
        source
        if source.camera.name in template.intrinsics
        else replace(source, stated=_stated_intrinsics(session, source.camera, source.pairs, insists))
        for source in sources
    ]


def state_lens(session: Session, recording: Recording, camera: str, lens: CameraLens) -> None:
    """Marks and calibrations of the recording begin with this lens from now on, whatever its own CameraInfo says.

    Raises:
        DocumentError, Problem: of `as_stated` and `check_size`; 404 where the recording has no such camera.
    """
    of_rig = rig_camera(session, session.get_one(Rig, recording.rig_id), camera)
    sensor = session.scalar(select(Sensor).where(Sensor.recording_id == recording.id, Sensor.name == camera))
    if sensor is None:
        raise not_found()
    stated = as_stated(camera, lens.model_dump())
    check_size(stated, of_rig, f"The lens of {lens.source or camera} is")
    K = stated["K"]
    # As of rectified images, whose lens is P of a CameraInfo.
    P = None if any(stated["D"]) else [*K[:3], 0.0, *K[3:6], 0.0, *K[6:], 0.0]
    more = {"distortion_model": lens.distortion_model, "R": None, "P": P, "source": lens.source}
    sensor.facts = sensor.facts | {"camera_info": stated | more}
    recording.version += 1


def _stated_intrinsics(session: Session, camera: RigCamera, pairs: CorrespondenceSet, insists: bool) -> Json | None:
    """What the recording of these pairs says of the camera (CameraInfo)."""
    statement = select(Sensor.facts).where(Sensor.recording_id == pairs.recording_id, Sensor.name == camera.name)
    facts = session.scalar(statement) or {}
    kind: ImageKind | None = camera.images["kind"] if camera.images else facts.get("image_kind")
    stated: Json | None = facts.get("camera_info") and lens_of_images(facts["camera_info"], kind)
    if not insists and (stated is None or not is_of_images(stated, camera)):
        return None  # the recording's own notes say that its lens is of other images
    if stated is None:
        which = "P of rectified images" if kind == "rectified" else "its intrinsics"
        raise unprocessable(
            "no_intrinsics_stated",
            f"The pairs of {camera.name} come from no recording that states {which}.",
            "State the lens (on the recording's page, or --intrinsics FILE). Or leave out intrinsics_from: recording "
            "(--stated) and intrinsics_as: locked (--intrinsics-as locked).",
        )
    check_size(stated, camera, f"The recording states intrinsics of {camera.name}")
    return stated
