"""The truth, which a calibration must find, and the rig as its owner would describe it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from apexcal.geometry.se3 import to_document
from workers.simulation.camera import LIDAR_FRAME, camera_frame
from workers.simulation.rig import START_NS, MountedCamera, SimulatedRig

TRUTH_FORMAT = "apexcal-simulation-truth/2"


def truth_document(rig: SimulatedRig) -> dict[str, Any]:
    """The ground truth as JSON; every list in ``frames`` and ``sweeps`` has one entry per frame or sweep.

    ``cameras``: by name ``transform`` (T_camera_lidar), ``intrinsics`` and ``frames``, which hold ``stamp_ns`` as the
    recording has it; ``time_ns``, when the frame was taken by the LiDAR's clock; ``apex_xyz``, the board's apex at
    that moment, metres, LiDAR frame; ``apex_uv``, its pixel ((0, 0) is the centre of the top-left one);
    ``apex_in_image``. The members of the first camera stand at the top level, too.
    If images are rectified, transform and intrinsics are those of the rectified camera: a turned pinhole.
    ``clock``: ``offset_ns``, the cameras' clock minus the LiDAR's; ``jitter_ns``, the standard
    deviation of a frame's stamp.
    ``sweeps``: ``stamp_ns``; ``apex_xyz`` at the stamp; ``scan_ns``, when the turning sensor looked at the
    apex; ``scan_apex_xyz``, where the apex was then: what a perfect detector would find.
    """
    cameras = {mounted.name: _camera(rig, mounted) for mounted in rig.cameras}
    return {
        "format": TRUTH_FORMAT,
        "settings": rig.options.model_dump(),
        "clock": {
            "offset_ns": round(rig.options.clock_offset_ms * 1e6),
            "jitter_ns": round(rig.options.clock_jitter_ms * 1e6),
        },
        **cameras[rig.cameras[0].name],
        "cameras": cameras,
        "sweeps": _sweeps(rig),
    }


def _camera(rig: SimulatedRig, mounted: MountedCamera) -> dict[str, Any]:
    apex = rig.walk.poses(_seconds(mounted.times_ns)).apex
    pixels = mounted.camera.project(apex)
    return {
        "transform": to_document(mounted.camera.T_camera_lidar),
        "intrinsics": mounted.camera.intrinsics_document(),
        "frames": {
            "stamp_ns": mounted.stamps_ns.tolist(),
            "time_ns": mounted.times_ns.tolist(),
            "apex_xyz": _rounded(apex, 6),
            "apex_uv": _rounded(pixels, 4),
            "apex_in_image": mounted.camera.sees(pixels).tolist(),
        },
    }


def _sweeps(rig: SimulatedRig) -> dict[str, Any]:
    start_s = _seconds(rig.sweep_stamps_ns)
    scan_s = scan_times_s(rig, start_s)
    return {
        "stamp_ns": rig.sweep_stamps_ns.tolist(),
        "apex_xyz": _rounded(rig.walk.poses(start_s).apex, 6),
        "scan_ns": (START_NS + np.round(scan_s * 1e9).astype(np.int64)).tolist(),
        "scan_apex_xyz": _rounded(rig.walk.poses(scan_s).apex, 6),
    }


def scan_times_s(rig: SimulatedRig, start_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """When the turning sensor looks at the apex in the sweeps that begin at ``start_s`` (S,), seconds."""
    scan_s = start_s
    for _ in range(3):  # the apex moves while the sensor turns towards it
        apex = rig.walk.poses(scan_s).apex
        scan_s = start_s + rig.lidar.scan_seconds(np.arctan2(apex[:, 1], apex[:, 0]))
    return scan_s


def rig_document(rig: SimulatedRig, names: Mapping[str, str]) -> dict[str, Any]:
    """The rig as its owner knows it, in the service's form: the mounts as drawn, not as they are.

    ``names``: what the recording calls ``lidar`` and each camera.
    """
    return {
        "name": "simulated",
        "lidar": {"frame": LIDAR_FRAME, "topic": names["lidar"]},
        "cameras": [
            {
                "name": mounted.name,
                "frame": camera_frame(mounted.name),
                "topic": names[mounted.name],
                "image_size": list(mounted.camera.image_size),
                "nominal": to_document(mounted.nominal),
            }
            for mounted in rig.cameras
        ],
    }


def _seconds(stamps_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    return (stamps_ns - START_NS).astype(np.float64) * 1e-9


def _rounded(values: NDArray[np.float64], digits: int) -> list[list[float | None]]:
    """Lists for JSON, which has no not-a-number: null where the lens cannot see the point."""
    rows: list[list[float]] = np.round(values, digits).tolist()
    return [[value if np.isfinite(value) else None for value in row] for row in rows]
