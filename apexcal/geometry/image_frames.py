"""The frame of a camera's images: rectified ones may be turned from the camera's own frame, which trees have.

A result is of the images' frame. ``images`` is a rig camera's document.
"""

from __future__ import annotations

from typing import Any

Document = dict[str, Any]
_SAME: Document = {"matrix": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]}


def T_images_camera(frame: str, images: Document | None) -> Document:  # noqa: N802 - a transform
    """Return the transform from the camera's frame to its images': the identity unless they are turned."""
    rotation = (images or {}).get("rotation")
    return _turn(f"{frame}_rectified" if rotation else frame, frame, rotation or _SAME)


def joint_of_images(joint: Document | None, turn: Document, lidar_frame: str) -> Document | None:
    """The rig's joint with ``T_child_camera`` to the frame of the images, by ``turn``, their ``T_images_camera``.

    Without a joint, images that are turned hang on the camera's own frame, and this on the LiDAR's.
    """
    own = turn["from_frame"]
    if turn["to_frame"] == own:
        return joint
    T_child_camera = joint["T_child_camera"] if joint else _turn(own, own, _SAME)
    T_parent_lidar = joint["T_parent_lidar"] if joint else _turn(lidar_frame, lidar_frame, _SAME)
    return {"T_parent_lidar": T_parent_lidar, "T_child_camera": between(T_child_camera, turn)}


def between(T_a_c: Document, T_b_c: Document) -> Document:
    """T_a_b in every form of its rotation."""
    # Imported here: it needs NumPy, which takes a twentieth of the start.
    from apexcal.geometry.se3 import from_document, to_document

    return to_document(from_document(T_a_c) @ from_document(T_b_c).inverse())


def _turn(to_frame: str, from_frame: str, rotation: Document) -> Document:
    return {"to_frame": to_frame, "from_frame": from_frame, "rotation": rotation, "translation_m": [0.0, 0.0, 0.0]}
