"""The rig that a recording proposes, from its rows."""

from __future__ import annotations

from sqlalchemy import select
from sqlalchemy.orm import Session

from apexcal.documents.rig_proposals import LIDAR, ProposalRequest, RigProposal
from apexcal.geometry.frame_tree import FrameTree, recorded_tree, urdf_tree
from apexcal.geometry.rig_proposal import RecordedSensor, propose_rig
from service.platform.db.recordings import Recording, Sensor
from service.platform.http.problems import Problem


def recorded_proposal(session: Session, recording: Recording, request: ProposalRequest) -> RigProposal:
    """Return the rig of a recording that was read.

    Raises:
        Problem: 409 ``not_read``.
        InputError: ``urdf_not_read``, ``frames_not_usable``.
    """
    rows = session.scalars(select(Sensor).where(Sensor.recording_id == recording.id).order_by(Sensor.id)).all()
    if LIDAR not in {row.name for row in rows}:
        raise Problem(
            409,
            "not_read",
            f"The recording {recording.name!r} is {recording.state}: its sensors are known once it is ready.",
            "Wait until it is, or read it again.",
        )
    trees: dict[str, FrameTree] = {}
    if request.urdf is not None:
        trees["the URDF"] = urdf_tree(request.urdf.encode())
    if fixed := (recording.facts or {}).get("static_transforms"):
        trees["the recording"] = recorded_tree(fixed)
    sensors = [_sensor(row) for row in sorted(rows, key=lambda row: row.name != LIDAR)]
    return propose_rig(sensors, trees, request, request.name)


def _sensor(row: Sensor) -> RecordedSensor:
    facts = row.facts
    size = (facts["width"], facts["height"]) if facts.get("width") and facts.get("height") else None
    info = facts.get("camera_info") or {}
    return RecordedSensor(row.name, row.topic, row.frame_id, size, facts.get("image_kind"), info.get("R"))
