"""Foxglove's messages: a point cloud, an image, a camera's calibration, the poses of frames.

Times are nanoseconds. Camera frames are optical: x right, y down, z forward, as Foxglove's are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from workers.readers.normalised.cdr import POINT_DTYPE
from workers.readers.viewing.protobuf_writing import (
    block,
    block_head,
    doubles,
    fixed32,
    integer,
    named_doubles,
    text,
)

_NUMERIC_TYPES: Final = {"<f4": 7, "<i4": 6, "<u2": 3}
_NO_TURN: Final = (0.0, 0.0, 0.0, 1.0)
_SAME_AXES: Final = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True, slots=True)
class Lens:
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


@dataclass(frozen=True, slots=True)
class FramePose:
    """``T_parent_child``: metres, and a unit quaternion."""

    parent: str
    child: str
    translation_m: Sequence[float]
    quaternion_xyzw: Sequence[float]


def point_cloud(stamp_ns: int, frame_id: str, size: int) -> bytes:
    """What stands before the ``size`` bytes of points, which are laid out as POINT_DTYPE and end the message."""
    pose = block(1, named_doubles((0.0, 0.0, 0.0))) + block(2, named_doubles(_NO_TURN))
    columns = [
        text(1, name) + fixed32(2, offset) + integer(3, _NUMERIC_TYPES[kind.str])
        for name, (kind, offset, *_) in (POINT_DTYPE.fields or {}).items()
    ]
    return b"".join(
        [
            _time(stamp_ns),
            text(2, frame_id),
            block(3, pose),
            fixed32(4, POINT_DTYPE.itemsize),
            *(block(5, column) for column in columns),
            block_head(6, size),
        ]
    )


def compressed_image(stamp_ns: int, frame_id: str, media_type: str, size: int) -> bytes:
    """What stands before the ``size`` bytes of an encoded image, which end the message."""
    kind = media_type.removeprefix("image/")
    return _time(stamp_ns) + text(3, kind) + text(4, frame_id) + block_head(2, size)


def camera_calibration(stamp_ns: int, frame_id: str, lens: Lens) -> bytes:
    """A lens; the rectified image is the undistorted one, with the same K."""
    K = lens.K
    P = (*K[0:3], 0.0, *K[3:6], 0.0, *K[6:9], 0.0)
    return b"".join(
        [
            _time(stamp_ns),
            fixed32(2, lens.width),
            fixed32(3, lens.height),
            text(4, lens.distortion_model),
            *(doubles(key, values) for key, values in ((5, lens.D), (6, K), (7, _SAME_AXES), (8, P))),
            text(9, frame_id),
        ]
    )


def frame_transforms(stamp_ns: int, poses: Sequence[FramePose]) -> bytes:
    """Where frames stand in their parents."""
    return b"".join(
        block(
            1,
            _time(stamp_ns)
            + text(2, pose.parent)
            + text(3, pose.child)
            + block(4, named_doubles(pose.translation_m))
            + block(5, named_doubles(pose.quaternion_xyzw)),
        )
        for pose in poses
    )


def _time(stamp_ns: int) -> bytes:
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    return block(1, integer(1, seconds) + integer(2, nanoseconds))
