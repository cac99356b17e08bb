"""Correspondence sets: immutable pairs, and one row for one content."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from sqlalchemy import Select, select, update
from sqlalchemy.orm import Session, defer

from service.calibrations.schemas import SetView
from service.correspondence_sets.pair_files import Columns
from service.db.calibrations import CorrespondenceSet
from service.db.clock import now
from service.db.digests import content_hash
from service.db.fleets import Rig, RigCamera
from service.http.problems import Problem


def rig_camera(session: Session, rig: Rig, name: str) -> RigCamera:
    """A rig's camera by its name. Raises :class:`Problem` 404 ``unknown_camera`` naming those there are."""
    cameras = session.scalars(select(RigCamera).where(RigCamera.rig_id == rig.id).order_by(RigCamera.position)).all()
    for camera in cameras:
        if camera.name == name:
            return camera
    raise Problem(
        404,
        "unknown_camera",
        f"The rig {rig.name!r} has no camera {name!r}.",
        f"Its cameras are {', '.join(camera.name for camera in cameras)}.",
        cameras=[camera.name for camera in cameras],
    )


def keep_set(session: Session, wanted: CorrespondenceSet) -> tuple[CorrespondenceSet, bool]:
    """The stored set of this content, and whether it is new. It is the newest of its camera either way.

    What it came from belongs to the content: a set goes with its recording, and no other's with it.
    ``wanted`` has everything but its hash and count. The rig's row is locked, so that of two who bring the same
    content at the same moment the second finds the first's.
    """
    session.execute(select(Rig.id).where(Rig.id == wanted.rig_id).with_for_update(key_share=True))
    origin = [str(one) if one else None for one in (wanted.recording_id, wanted.detection_id)]
    wanted.content_hash = content_hash({"pairs": wanted.pairs, "origin": origin, "notes": wanted.notes})
    wanted.count = len(wanted.pairs["x"])
    known = session.scalar(
        select(CorrespondenceSet).where(
            CorrespondenceSet.rig_id == wanted.rig_id,
            CorrespondenceSet.camera == wanted.camera,
            CorrespondenceSet.content_hash == wanted.content_hash,
        )
    )
    if known is not None:
        # A statement, not the object: its recording may be deleted at this moment, and then there is nothing to say.
        of = update(CorrespondenceSet).where(CorrespondenceSet.id == known.id)
        session.execute(of.values(brought_at=now()), execution_options={"synchronize_session": False})
        return known, False
    session.add(wanted)
    session.flush()
    return wanted, True


def notes_on_image(columns: Columns, camera: RigCamera) -> list[str]:
    """A sentence where marks lie outside the image that the rig says the camera has."""
    outside = sum(
        not (-0.5 <= u <= camera.image_width - 0.5 and -0.5 <= v <= camera.image_height - 0.5)
        for u, v in zip(columns["u"], columns["v"], strict=True)
    )
    if not outside:
        return []
    which = "1 pair lies" if outside == 1 else f"{outside} pairs lie"
    return [
        f"{which} outside the image of {camera.image_width} x {camera.image_height} pixels that the rig gives "
        f"for {camera.name}: is the image size right, are u and v in this order?"
    ]


def summaries() -> Select[*tuple[Any, ...]]:
    """Sets without their pairs, which may be many."""
    flagged = CorrespondenceSet.pairs["flagged"].label("flagged")
    return select(CorrespondenceSet, flagged).options(defer(CorrespondenceSet.pairs))


def set_view(row: CorrespondenceSet, flagged: Iterable[bool] | None) -> SetView:
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
        flagged=sum(flagged or ()),
        created_at=row.created_at,
    )
