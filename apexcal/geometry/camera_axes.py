"""Which way a camera's frame points, in a tree's own up and forward."""

from __future__ import annotations

from collections.abc import Iterable
from math import asin, atan2, cos, degrees, pi
from typing import Final, NamedTuple

from apexcal.documents.name_words import words
from apexcal.geometry.frame_tree import FrameTree
from apexcal.geometry.rotations import FORWARD_LIDAR_TO_OPTICAL
from apexcal.geometry.se3 import SE3

OPTICAL: Final = frozenset(("optical",))
_CAMERA_WORDS: Final = frozenset(("optical", "cam", "camera"))
# Of REP 105: they do not move with the vehicle, and the earth's z is no up.
_OUTSIDE_WORDS: Final = frozenset(("earth", "utm", "world", "map", "odom"))
_REAR_WORDS: Final = frozenset(("rear", "back", "backward", "behind", "tail"))
# Half way between level and straight up. The z of a body's frame points up, that of an optical frame (REP 103) ahead.
_BODY_FROM: Final = cos(pi / 4.0)
# A frame that is read with its axes exchanged looks straight up or down, but for how its sensors lean.
_STEEP_DEG: Final = 60.0
_BACKWARD_DEG: Final = 135.0


def upright(trees: Iterable[FrameTree], lidar: str, camera: str) -> SE3:
    """Return T_top_lidar to the vehicle's highest frame above the LiDAR, where x is forward and z up (REP 103).

    Only fixed joints lead to it. Where there is none, or it is a camera's, the LiDAR's own frame takes its place.
    """
    for tree in trees:
        top = lidar
        for joint in tree.above(lidar) if lidar in tree.frames else []:
            if not joint.fixed or words(joint.parent) & _OUTSIDE_WORDS:
                break
            top = joint.parent
        if top not in (lidar, camera) and not words(top) & _CAMERA_WORDS:
            return tree.transform(top, lidar)
    return SE3(lidar, lidar)


def optical_frame(tree: FrameTree, top: str, frame: str) -> tuple[str, SE3]:
    """Return the frame of the tree that is nearest to the camera's optical one, and ``T_optical_frame`` from it.

    Drivers stamp images with the camera's body, too (x forward, z up). Its optical frame stands below it in the tree,
    or is made here, turned as REP 103 has it.
    """
    if words(frame) & OPTICAL:
        return frame, SE3(frame, frame)
    below = [
        each
        for each in tree.frames
        if words(each) & OPTICAL and any(joint.parent == frame for joint in tree.above(each)[:1])
    ]
    if len(below) == 1:
        return below[0], SE3(below[0], below[0])
    is_body = tree.transform(frame, top).R[2, 2] > _BODY_FROM
    return frame, SE3(f"{frame}_optical", frame, FORWARD_LIDAR_TO_OPTICAL) if is_body else SE3(frame, frame)


class AxisDirection(NamedTuple):
    """Where a camera looks, in words, and whether hardly any camera of its name does."""

    sides: str
    is_unlikely: bool


def axis_direction(T_camera_lidar: SE3, T_top_lidar: SE3, name: str) -> AxisDirection:
    """Return where the optical axis leads in the highest frame. ``name`` has the word of a rear camera, or not."""
    x, y, z = (T_top_lidar.R @ T_camera_lidar.R[2]).tolist()
    left, up = degrees(atan2(y, x)), degrees(asin(max(-1.0, min(1.0, z))))
    sides = f"{abs(left):.0f} degrees {'left' if left > 0 else 'right'}, {abs(up):.0f} {'up' if up > 0 else 'down'}"
    off = 180.0 - abs(left) if words(name) & _REAR_WORDS else abs(left)
    return AxisDirection(f"{sides} in {T_top_lidar.to_frame}", abs(up) > _STEEP_DEG or off > _BACKWARD_DEG)
