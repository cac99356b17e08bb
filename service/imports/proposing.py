"""The rig that a recording proposes, from its rows."""

from __future__ import annotations

from typing import Any, NamedTuple

from sqlalchemy import select
from sqlalchemy.orm import Session

from apexcal.documents.errors import InputError
from apexcal.documents.rig_proposals import LIDAR, ProposalRequest, RigProposal
from apexcal.geometry.frame_tree import FrameTree, recorded_tree, urdf_tree
from apexcal.geometry.rig_proposal import RecordedSensor, propose_rig
from service.fleets.actions import describe
from service.platform.broker.hints import hint
from service.platform.db.fleets import Rig
from service.platform.db.recordings import Recording, Sensor


class ReadFrames(NamedTuple):
    """The parts of a recording that tell its rig: sensors, the LiDAR first, and fixed transforms."""

    sensors: list[RecordedSensor]
    static_transforms: Any


def read_frames(session: Session, recording: Recording) -> ReadFrames:
    """Return them of a recording that was read. Raises InputError ``not_read``."""
    rows = session.scalars(select(Sensor).where(Sensor.recording_id == recording.id).order_by(Sensor.id)).all()
    if LIDAR not in {row.name for row in rows}:
        raise InputError(
            "not_read",
            f"The recording {recording.name!r} is {recording.state}: its sensors are known once it is ready.",
            "Wait until it is, or read it again.",
        )
    sensors = [_sensor(row) for row in sorted(rows, key=lambda row: row.name != LIDAR)]
    return ReadFrames(sensors, (recording.facts or {}).get("static_transforms"))


def proposed(frames: ReadFrames, request: ProposalRequest) -> RigProposal:
    """Return the rig that they propose. Raises InputError ``urdf_not_read``, ``frames_not_usable``."""
    trees: dict[str, FrameTree] = {}
    if request.urdf is not None:
        trees["the URDF"] = urdf_tree(request.urdf.encode())
    if frames.static_transforms:
        trees["the recording"] = recorded_tree(frames.static_transforms)
    return propose_rig(frames.sensors, trees, request, request.name)


def describe_empty_rig(session: Session, recording: Recording) -> None:
    """Describe a rig without cameras by the recording read for it. What is assumed becomes a warning."""
    rig = session.get_one(Rig, recording.rig_id)
    if rig.cameras:
        return
    try:
        proposal = proposed(read_frames(session, recording), ProposalRequest.model_validate({"name": rig.name}))
    except InputError as error:
        recording.warnings = [*recording.warnings, f"The rig is not described. {error.message}"]
        return
    describe(rig, proposal.rig)
    rig.version += 1
    assumed = [f"{question.sentence} Assumed: {question.assumed}." for question in proposal.questions]
    recording.warnings = [*recording.warnings, *assumed]
    session.flush()
    hint(session, rig.fleet_id, "rig", rig.id)


def _sensor(row: Sensor) -> RecordedSensor:
    facts = row.facts
    size = (facts["width"], facts["height"]) if facts.get("width") and facts.get("height") else None
    info = facts.get("camera_info") or {}
    return RecordedSensor(row.name, row.topic, row.frame_id, size, facts.get("image_kind"), info.get("R"))
