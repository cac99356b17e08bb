"""The edits of a recording: cameras' intrinsics, and the poses of frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

from pydantic import TypeAdapter

from apexcal.documents.copies import PutPose


@dataclass(frozen=True, slots=True)
class CameraEdit:
    """A camera as calibrated.

    Attributes:
        name: the camera's name in the rig.
        topic: its images in the recording.
        frame_id: its optical frame there.
        width, height: pixels.
        distortion_model: as CameraInfo names it.
        K: (9,) by rows, pixels. D: in the model's order.
        is_rectified: whether the images are rectified, so that the lens is P of a CameraInfo.
        R: (9,), P: (12,) of a new CameraInfo by rows; empty: no turn, and the lens again.
    """

    name: str
    topic: str
    frame_id: str
    width: int
    height: int
    distortion_model: str
    K: tuple[float, ...]
    D: tuple[float, ...]
    is_rectified: bool = False
    R: tuple[float, ...] = ()
    P: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class Edits:
    """All edits of a recording. ``lidar_frame`` is the points' frame."""

    lidar_frame: str
    cameras: Sequence[CameraEdit]
    poses: Sequence[PutPose]

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Self:
        """Make the edits of plain data, as the service plans them."""
        return TypeAdapter(cls).validate_python(data)


@dataclass(slots=True)
class EditCounts:
    """Counts of the messages of each kind that were replaced, added, or copied as they are."""

    copied: int = 0
    replaced: int = 0
    added: int = 0
