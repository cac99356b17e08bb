"""Copies of a recording's own file that carry its calibration."""

from __future__ import annotations

from typing import Annotated
from uuid import UUID

from pydantic import Field

from apexcal.documents.base import Document, Name, Received, Stored
from apexcal.documents.fleets import CameraName
from apexcal.documents.publications import CURRENT
from apexcal.documents.studies import StudyView


class CopyRequest(Received):
    """Ask for a recording's file with CameraInfo and ``/tf_static`` as calibrated.

    ``cameras``: by default all cameras of the recording that are given a calibration under ``alias``. ``joints``
    names the frame whose pose is replaced, by camera; by default the first one towards the camera where the ways to
    camera and LiDAR part.
    """

    alias: Annotated[str, Field(max_length=64)] = CURRENT
    cameras: Annotated[list[CameraName], Field(default_factory=list, max_length=16)]
    joints: Annotated[dict[CameraName, Name], Field(default_factory=dict, max_length=16)]


class PutPose(Document):
    """``T_parent_child`` as written into the copy; ``is_new``: the recording did not state it."""

    parent: str
    child: str
    translation_m: list[float]
    quaternion_xyzw: list[float]
    is_new: bool


class CopiedFile(Document):
    """The copy: its name, size and SHA-256, and how many messages were copied, replaced and added."""

    file_name: str
    size: int
    sha256: str
    copied: int
    replaced: int
    added: int


class CopyView(StudyView):
    """A copy of a recording; when it is done, its file can be read. ``results`` are by camera."""

    result: Stored[CopiedFile | None]
    results: dict[str, UUID]
    poses: Stored[list[PutPose]]
