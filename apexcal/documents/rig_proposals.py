"""A rig as a recording proposes it, what it leaves open, and what a person answers."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from pydantic import Field

from apexcal.documents.base import Document, Name, Received
from apexcal.documents.fleets import CameraName, NewRig

LIDAR = "lidar"
Direction = Literal["forward", "left", "backward", "right", "tree"]
AS_TREE: Final = "tree"


class RigAnswers(Received):
    """A person's statements about the sensors, by their names; the LiDAR is ``lidar``.

    ``frames``: a sensor's frame in the vehicle's tree. ``looks``: where a camera looks, with x forward and y left in
    the tree's highest frame, or without a tree in the LiDAR's; it replaces what a tree says, but for ``tree``, which
    confirms it. ``joints``: the joint, or its child link, that a camera's
    results are also given for.
    """

    frames: Annotated[dict[CameraName, Name], Field(default_factory=dict, max_length=17)]
    looks: Annotated[dict[CameraName, Direction], Field(default_factory=dict, max_length=16)]
    joints: Annotated[dict[CameraName, Name], Field(default_factory=dict, max_length=16)]


class RigQuestion(Document):
    """A question that neither recording nor URDF answers for a sensor. The proposed rig assumes ``assumed``.

    ``asks`` names the member of :class:`RigAnswers` that answers it; ``choices`` are its possible values.
    """

    sensor: str
    asks: Literal["frames", "looks"]
    sentence: str
    choices: list[str]
    assumed: str


class RigProposal(Document):
    """A rig that may be taken as it is, or edited first. ``notes`` say where each mount comes from."""

    rig: NewRig
    notes: list[str]
    questions: list[RigQuestion]


class ProposalRequest(RigAnswers):
    """Propose a rig for a recording, with the vehicle's URDF if there is one."""

    urdf: Annotated[str, Field(max_length=250_000)] | None = None
    name: Name = "rig"
