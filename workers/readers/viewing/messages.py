"""Foxglove's messages as viewers read them: a point cloud, an image, a camera's calibration, the poses of frames.

Times are nanoseconds. Camera frames are optical: x right, y down, z forward, as Foxglove's are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.descriptor import FileDescriptor
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.timestamp_pb2 import Timestamp

from apexcal.documents.recordings import FixedFrame
from workers.readers.recording import Sweep

ENCODING: Final = "protobuf"
_POINT: Final = np.dtype(
    {
        "names": ["x", "y", "z", "intensity", "offset_ns", "ring"],
        "formats": ["<f4", "<f4", "<f4", "<f4", "<i4", "<u2"],
        "offsets": [0, 4, 8, 12, 16, 20],
        "itemsize": 24,
    }
)
KINDS: Final[tuple[Any, ...]] = (PointCloud, CompressedImage, CameraCalibration, FrameTransforms)
_NUMERIC_TYPES: Final = {"<f4": 7, "<i4": 6, "<u2": 3}
_SAME_AXES: Final = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
_COLUMNS: Final = [
    PackedElementField(name=name, offset=offset, type=_NUMERIC_TYPES[kind.str])  # pyright: ignore[reportArgumentType]
    for name, (kind, offset, *_) in (_POINT.fields or {}).items()
]


@dataclass(frozen=True, slots=True)
class ViewerLens:
    """A camera's intrinsics in Foxglove's words.

    Attributes:
        width, height: pixels.
        distortion_model: ``plumb_bob`` or ``kannala_brandt``. D: in its order.
        K: (9,) by rows, pixels.
    """

    width: int
    height: int
    distortion_model: str
    K: Sequence[float]
    D: Sequence[float]


def descriptor_set(kind: Any) -> bytes:
    """A serialized FileDescriptorSet of a message's class, as MCAP files carry it: what it needs comes first."""
    files = FileDescriptorSet()

    def add(file: FileDescriptor) -> None:
        for needed in file.dependencies:
            add(needed)
        if file.name not in {listed.name for listed in files.file}:
            file.CopyToProto(files.file.add())

    add(kind.DESCRIPTOR.file)
    return files.SerializeToString()


def point_cloud(sweep: Sweep, frame_id: str) -> bytes:
    """A sweep's points with intensity, nanoseconds after the stamp (at most 2.1 s) and ring."""
    points = np.zeros(len(sweep.xyz), _POINT)
    for axis, name in enumerate("xyz"):
        points[name] = sweep.xyz[:, axis]
    points["intensity"], points["ring"] = sweep.intensity, sweep.ring
    points["offset_ns"] = np.clip(sweep.offset_ns, -(2**31), 2**31 - 1)
    pose = Pose(position=Vector3(), orientation=Quaternion(w=1.0))
    return PointCloud(
        timestamp=_time(sweep.stamp_ns),
        frame_id=frame_id,
        pose=pose,
        point_stride=_POINT.itemsize,
        fields=_COLUMNS,
        data=points.tobytes(),
    ).SerializeToString()


def compressed_image(stamp_ns: int, frame_id: str, media_type: str, data: bytes) -> bytes:
    """An encoded image."""
    kind = media_type.removeprefix("image/")
    image = CompressedImage(timestamp=_time(stamp_ns), frame_id=frame_id, format=kind, data=data)
    return image.SerializeToString()


def camera_calibration(stamp_ns: int, frame_id: str, lens: ViewerLens) -> bytes:
    """A lens; the rectified image is the undistorted one, with the same K."""
    K = lens.K
    return CameraCalibration(
        timestamp=_time(stamp_ns),
        frame_id=frame_id,
        width=lens.width,
        height=lens.height,
        distortion_model=lens.distortion_model,
        D=lens.D,
        K=K,
        R=_SAME_AXES,
        P=(*K[0:3], 0.0, *K[3:6], 0.0, *K[6:9], 0.0),
    ).SerializeToString()


def frame_transforms(stamp_ns: int, poses: Sequence[FixedFrame]) -> bytes:
    """Return the poses of frames in their parents."""
    transforms = [
        FrameTransform(
            timestamp=_time(stamp_ns),
            parent_frame_id=pose.parent,
            child_frame_id=pose.child,
            translation=Vector3(**dict(zip("xyz", pose.translation_m, strict=True))),
            rotation=Quaternion(**dict(zip("xyzw", pose.quaternion_xyzw, strict=True))),
        )
        for pose in poses
    ]
    return FrameTransforms(transforms=transforms).SerializeToString()


def _time(stamp_ns: int) -> Timestamp:
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    return Timestamp(seconds=seconds, nanos=nanoseconds)
