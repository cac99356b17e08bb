"""Copies of a recording's own file that carry its calibration."""

from __future__ import annotations

from typing import Annotated, Literal, Self
from uuid import UUID

from pydantic import Field, model_validator

from apexcal.documents.analyses import AnalysisView, RecordingQuestion, StoredFile
from apexcal.documents.base import Document, Name, Stored
from apexcal.documents.fleets import CameraName
from apexcal.documents.publications import CURRENT


class CopyRequest(RecordingQuestion):
    """Ask for a recording's file with CameraInfo and ``/tf_static`` as calibrated.

    ``for_viewers`` asks instead for an MCAP file of Foxglove's messages, with undistorted frames beside the recorded
    ones, of any kind of recording. ``cameras``: by default all with a published calibration under ``alias``.
    ``joints`` names, by camera, the frame whose pose is replaced; by default the first frame on the camera's side of
    the nearest common ancestor of camera and LiDAR.
    """

    kind: Literal["calibrated_copy"]
    alias: Annotated[str, Field(max_length=64)] = CURRENT
    cameras: Annotated[list[CameraName], Field(default_factory=list, max_length=16)]
    joints: Annotated[dict[CameraName, Name], Field(default_factory=dict, max_length=16)]
    for_viewers: bool = False

    @model_validator(mode="after")
    def _moves_no_joint(self) -> Self:
        if self.for_viewers and self.joints:
            raise ValueError("a file for viewers replaces no pose; leave `joints` out")
        return self


class PutPose(Document):
    """``T_parent_child`` as written into the copy. ``is_new``: the recording states no such pose."""

    parent: str
    child: str
    translation_m: list[float]
    quaternion_xyzw: list[float]
    is_new: bool


class CopiedFile(StoredFile):
    """The copy, and how many messages were copied, replaced and added.

    ``left_out``: frames that were not undistorted, because they are damaged or of another size than the calibration.
    """

    copied: int
    replaced: int
    added: int
    left_out: int = 0


class CopyView(AnalysisView):
    """A copy of a recording; when it is done, its file can be read. ``results`` are by camera."""

    kind: Literal["calibrated_copy"]
    result: Stored[CopiedFile | None]
    results: dict[str, UUID]
    poses: Stored[list[PutPose]]
    for_viewers: bool = False
