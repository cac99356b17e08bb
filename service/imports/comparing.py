"""Compare a result with a mount or lens that somebody states."""

from __future__ import annotations

from dataclasses import replace
from typing import Final, Literal

import numpy as np

from apexcal.documents.imports import ComparisonRequest, LensDifference, ReadCamera, StatedComparison
from apexcal.documents.results import FitResult
from apexcal.geometry.result_differences import compared_with_stated
from apexcal.geometry.rotations import FORWARD_LIDAR_TO_OPTICAL, vector_from_rotation
from apexcal.geometry.se3 import SE3, Floats, from_document
from service.imports.contents import refused
from service.imports.formats import files_view, transform_view
from service.imports.plausibility import mount_doubts
from service.platform.http.problems import unprocessable

ReadAs = Literal["stated", "inverted", "body", "inverted_body", "none"]
# Within so much of the truth a nominal mount has to be; what is farther off is another reading of the transform.
_ALIKE_DEG: Final = 30.0
_ADVICE: Final[dict[ReadAs, str]] = {
    "inverted": "It fits if it is inverted: it seems to map camera points into the LiDAR's frame.",
    "body": "It fits if its camera frame is the body's (x forward, y left, z up) and not the optical one.",
    "inverted_body": "It fits if it is inverted and its camera frame is the body's (x forward), not the optical one.",
    "none": "It is over 30 degrees from the result, also if it is inverted or given for the camera's body frame.",
}


def stated_comparison(body: ComparisonRequest, result: FitResult) -> StatedComparison:
    """Return how far a published result is.

    Raises:
        Problem: 422 ``calibration_file_not_read``, ``nothing_to_compare``.
    """
    stated, camera = _stated(body)
    solved = from_document(result.transform)
    hints = list(camera.doubts) if camera is not None else [] if stated is None else mount_doubts(stated)
    lens = _lens_difference(camera, result, hints)
    if stated is None:
        return StatedComparison(
            T_camera_lidar=None, rotation_deg=None, translation_mm=None, sigmas=None, differs=None, read_as=None,
            lens=lens, hints=hints,
        )  # fmt: skip
    if (stated.to_frame, stated.from_frame) == (solved.from_frame, solved.to_frame):
        raise unprocessable(
            "invalid_request",
            f"T_camera_lidar maps points of {solved.from_frame!r} into {solved.to_frame!r}, and this one says the "
            "opposite.",
            "Invert it, or name its frames the other way round.",
        )
    stated = replace(stated, to_frame=solved.to_frame, from_frame=solved.from_frame)
    read_as = _reading(stated, solved)
    if read_as != "stated":
        hints.append(_ADVICE[read_as])
    measured = compared_with_stated(result, stated)
    return StatedComparison(
        T_camera_lidar=transform_view(stated), read_as=read_as, lens=lens, hints=hints, **measured
    )


def _stated(body: ComparisonRequest) -> tuple[SE3 | None, ReadCamera | None]:
    if (body.T_camera_lidar is None) == (body.files is None):
        raise unprocessable(
            "nothing_to_compare", "The body needs either T_camera_lidar or files.", "Send one of the two."
        )
    if body.T_camera_lidar is not None:
        return from_document(body.T_camera_lidar), None
    assert body.files is not None
    cameras = files_view(body.files).cameras
    names = ", ".join(camera.name for camera in cameras)
    chosen = [camera for camera in cameras if body.camera in (None, camera.name)]
    if len(chosen) != 1:
        raise refused(f"The files hold the cameras {names}.", "Name one of them as `camera`.")
    mount = chosen[0].T_camera_lidar
    return (None if mount is None else from_document(mount)), chosen[0]


def _reading(stated: SE3, solved: SE3) -> ReadAs:
    inverse = stated.inverse()
    readings: dict[ReadAs, Floats] = {
        "stated": stated.R,
        "inverted": inverse.R,
        "body": FORWARD_LIDAR_TO_OPTICAL @ stated.R,
        "inverted_body": FORWARD_LIDAR_TO_OPTICAL @ inverse.R,
    }
    off: dict[ReadAs, float] = {
        name: float(np.degrees(np.linalg.norm(vector_from_rotation(R @ solved.R.T)))) for name, R in readings.items()
    }
    if off["stated"] <= _ALIKE_DEG:
        return "stated"
    nearest: ReadAs = min(off, key=lambda name: off[name])
    return nearest if off[nearest] <= _ALIKE_DEG else "none"


def _lens_difference(camera: ReadCamera | None, result: FitResult, hints: list[str]) -> LensDifference | None:
    if camera is None or camera.lens is None:
        return None
    K, own = camera.lens.K, result.intrinsics
    if camera.lens.model != result.model:
        hints.append(f"The stated lens is {camera.lens.model}, the result's {result.model}.")
    return LensDifference(f_x=own.f_x - K[0], f_y=own.f_y - K[4], c_x=own.c_x - K[2], c_y=own.c_y - K[5])
