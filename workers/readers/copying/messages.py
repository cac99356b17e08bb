"""CameraInfo and TFMessage as ROS 1 and ROS 2 write them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np

from apexcal.documents.copies import PutPose
from workers.readers.copying.edits import CameraEdit
from workers.readers.ros.camera_info import matrices_of
from workers.readers.ros.ros_types import INFO, TRANSFORM, fixed_types

_NO_TURN: Final = np.eye(3).reshape(-1)


class Messages:
    """Messages in one encoding: ``ros1`` or ``cdr``."""

    def __init__(self, encoding: str) -> None:
        self._types = fixed_types(encoding)
        self._is_ros1 = encoding == "ros1"
        types = self._types
        self._read: Callable[[bytes, str], Any] = types.deserialize_ros1 if self._is_ros1 else types.deserialize_cdr
        self._write: Callable[[Any, str], Any] = types.serialize_ros1 if self._is_ros1 else types.serialize_cdr

    def new_info(self, camera: CameraEdit, stamp_ns: int, frame_id: str) -> bytes:
        """A camera's intrinsics at the moment of one of its images."""
        roi = self._make("sensor_msgs/msg/RegionOfInterest", 0, 0, 0, 0, False)
        header = self._header(stamp_ns, frame_id)
        return self._written(self._make(INFO, header, *_lens(camera), 0, 0, roi), INFO)

    def with_lens(self, raw: bytes, camera: CameraEdit) -> bytes:
        """A CameraInfo with this lens; stamp, frame, binning and region of interest stay.

        Of rectified images P alone is replaced; K, D and R stay those of the raw ones.
        """
        info = self._read(raw, INFO)
        lens = _lens(camera)
        d, k, r, p = matrices_of(info)
        if camera.is_rectified and p[0] and (np.any(d) or not np.array_equal(r, _NO_TURN)):
            lens[-1][3] = p[3] * (lens[-1][0] / p[0])  # -f_x b of a stereo camera
            lens = (*lens[:2], info.distortion_model, d, k, r, lens[-1])
        message = self._make(INFO, info.header, *lens, info.binning_x, info.binning_y, info.roi)
        return self._written(message, INFO)

    def children(self, raw: bytes) -> list[str]:
        """The frames that a TFMessage places."""
        return [plain(transform.child_frame_id) for transform in self._read(raw, TRANSFORM).transforms]

    def with_poses(self, raw: bytes, poses: Sequence[PutPose]) -> tuple[bytes, set[str]]:
        """A TFMessage with these poses where it places their children; and which it does. Others stay as they are."""
        message = self._read(raw, TRANSFORM)
        by_child = {pose.child: pose for pose in poses}
        children: set[str] = set()
        placed: list[Any] = []
        for transform in message.transforms:
            pose = by_child.get(plain(transform.child_frame_id))
            if pose is None:
                placed.append(transform)
                continue
            children.add(pose.child)
            header = transform.header
            if plain(header.frame_id) != pose.parent:
                header = self._header_like(header, pose.parent)
            placed.append(self._stamped(header, transform.child_frame_id, pose))
        return (self._written(self._make(TRANSFORM, placed), TRANSFORM) if children else raw), children

    def new_poses(self, poses: Sequence[PutPose], stamp_ns: int) -> bytes:
        """A TFMessage that places these frames."""
        placed = [self._stamped(self._header(stamp_ns, pose.parent), pose.child, pose) for pose in poses]
        return self._written(self._make(TRANSFORM, placed), TRANSFORM)

    def _stamped(self, header: Any, child: str, pose: PutPose) -> Any:
        offset = self._make("geometry_msgs/msg/Vector3", *pose.translation_m)
        turn = self._make("geometry_msgs/msg/Quaternion", *pose.quaternion_xyzw)
        transform = self._make("geometry_msgs/msg/Transform", offset, turn)
        return self._make("geometry_msgs/msg/TransformStamped", header, child, transform)

    def _header(self, stamp_ns: int, frame_id: str) -> Any:
        time = self._make("builtin_interfaces/msg/Time", *divmod(stamp_ns, 1_000_000_000))
        return self._make("std_msgs/msg/Header", *([0] if self._is_ros1 else []), time, frame_id)

    def _header_like(self, header: Any, frame_id: str) -> Any:
        return self._make("std_msgs/msg/Header", *([header.seq] if self._is_ros1 else []), header.stamp, frame_id)

    def _make(self, kind: str, *fields: Any) -> Any:
        return self._types.types[kind](*fields)

    def _written(self, message: Any, kind: str) -> bytes:
        return bytes(self._write(message, kind))


def _lens(camera: CameraEdit) -> tuple[Any, ...]:
    """height, width, model, D, K, R, P: the rectified image is the undistorted one, with the same K, unless said."""
    K = np.array(camera.K, np.float64)
    P = np.array(camera.P) if camera.P else np.hstack([K.reshape(3, 3), np.zeros((3, 1))]).reshape(-1)
    R = np.array(camera.R) if camera.R else _NO_TURN
    return (camera.height, camera.width, camera.distortion_model, np.array(camera.D, np.float64), K, R, P)


def plain(frame: str) -> str:
    """A frame's name as tf2 compares it: without the slash of older versions."""
    return frame.removeprefix("/")
