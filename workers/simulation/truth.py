"""What the simulator knows and the calibration must find, and the rig as its owner would describe it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from workers.geometry.transforms import to_document
from workers.simulation.camera import Camera, nominal_mount
from workers.simulation.lidar import Lidar
from workers.simulation.walker import Walk

TRUTH_FORMAT = "apexcal-simulation-truth/1"


def truth_document(
    *,
    settings: dict[str, Any],
    camera: Camera,
    lidar: Lidar,
    walk: Walk,
    start_ns: int,
    sweep_stamps_ns: NDArray[np.int64],
    frame_stamps_ns: NDArray[np.int64],
) -> dict[str, Any]:
    """The ground truth as JSON; every list in ``frames`` and ``sweeps`` has one entry per frame or sweep.

    ``frames``: ``stamp_ns``; ``apex_xyz``, the board's apex at that moment, metres, LiDAR frame; ``apex_uv``,
    its pixel ((0, 0) is the centre of the top-left one); ``apex_in_image``.
    ``sweeps``: ``stamp_ns``; ``apex_xyz`` at the stamp; ``scan_ns``, when the turning sensor looked at the
    apex; ``scan_apex_xyz``, where the apex was then: what a perfect detector would find.
    """
    frame_s, sweep_s = (_seconds(stamps, start_ns) for stamps in (frame_stamps_ns, sweep_stamps_ns))
    at_frames = walk.poses(frame_s).apex
    at_sweeps = walk.poses(sweep_s).apex
    scan_s = sweep_s.copy()
    for _ in range(3):  # the apex moves while the sensor turns towards it
        apex = walk.poses(scan_s).apex
        scan_s = sweep_s + lidar.scan_seconds(np.arctan2(apex[:, 1], apex[:, 0]))
    pixels = camera.project(at_frames)
    return {
        "format": TRUTH_FORMAT,
        "settings": settings,
        "transform": to_document(camera.T_camera_lidar),
        "intrinsics": camera.intrinsics_document(),
        "frames": {
            "stamp_ns": frame_stamps_ns.tolist(),
            "apex_xyz": _rounded(at_frames, 6),
            "apex_uv": _rounded(pixels, 4),
            "apex_in_image": camera.sees(pixels).tolist(),
        },
        "sweeps": {
            "stamp_ns": sweep_stamps_ns.tolist(),
            "apex_xyz": _rounded(at_sweeps, 6),
            "scan_ns": (start_ns + np.round(scan_s * 1e9).astype(np.int64)).tolist(),
            "scan_apex_xyz": _rounded(walk.poses(scan_s).apex, 6),
        },
    }


def rig_document(camera: Camera, lidar_topic: str, camera_topic: str) -> dict[str, Any]:
    """The rig as its owner knows it, in the form that the service takes: the mount from the drawing, not as it is."""
    nominal = nominal_mount()
    return {
        "name": "simulated",
        "lidar": {"frame": nominal.from_frame, "topic": lidar_topic},
        "cameras": [
            {
                "name": "front",
                "frame": nominal.to_frame,
                "topic": camera_topic,
                "image_size": list(camera.image_size),
                "nominal": to_document(nominal),
            }
        ],
    }


def _seconds(stamps_ns: NDArray[np.int64], start_ns: int) -> NDArray[np.float64]:
    return (stamps_ns - start_ns).astype(np.float64) * 1e-9


def _rounded(values: NDArray[np.float64], digits: int) -> list[list[float | None]]:
    """Lists for JSON, which has no not-a-number: null where the lens cannot see the point."""
    rows: list[list[float]] = np.round(values, digits).tolist()
    return [[value if np.isfinite(value) else None for value in row] for row in rows]
