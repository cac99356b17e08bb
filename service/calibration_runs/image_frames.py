"""The frame of a camera's images: rectified ones are turned by R from the camera's own frame, which trees have.

A result is of the images' frame. ``images`` is a rig camera's document: its ``kind``, and of rectified ones ``R``.
"""

from __future__ import annotations

from typing import Any

Document = dict[str, Any]


def frame_of_images(frame: str, images: Document | None) -> str:
    """The frame that ``T_camera_lidar`` of a result leads to."""
    return f"{frame}_rectified" if images and images.get("R") else frame


def T_images_camera(frame: str, images: Document | None) -> Document | None:  # noqa: N802 - a transform
    """From the camera's own frame to that of its rectified images; None where they are the same."""
    if not images or not images.get("R"):
        return None
    return _turn(frame_of_images(frame, images), frame, images["R"])


def joint_of_images(joint: Document | None, frame: str, lidar_frame: str, images: Document | None) -> Document | None:
    """The joint with ``T_child_camera`` of the images' frame.

    Without a joint, rectified images hang on the camera's own frame, and this on the LiDAR's.
    """
    turn = T_images_camera(frame, images)
    if turn is None:
        return joint
    # Imported here: it needs NumPy, which takes a twentieth of the start.
    from service.calibration_runs.transforms import T_vehicle_camera

    same = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    around = joint or {
        "T_parent_lidar": _turn(lidar_frame, lidar_frame, same),
        "T_child_camera": _turn(frame, frame, same),
    }
    return around | {"T_child_camera": T_vehicle_camera(around["T_child_camera"], turn)}


def _turn(to_frame: str, from_frame: str, matrix: list[list[float]]) -> Document:
    return {
        "to_frame": to_frame,
        "from_frame": from_frame,
        "rotation": {"matrix": matrix},
        "translation_m": [0.0, 0.0, 0.0],
    }
