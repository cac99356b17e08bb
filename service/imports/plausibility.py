"""Whether a lens or a mount that a file states can be what it says it is."""

from __future__ import annotations

from math import acos, cos, degrees, pi
from typing import Final, NamedTuple

import numpy as np

from apexcal.documents.camera_models import ModelName
from apexcal.documents.errors import DocumentError
from apexcal.documents.lenses import check_lens
from apexcal.geometry.se3 import SE3, Floats
from service.imports.contents import FileLens, refused

# The default bounds of a search, as shares of the image's width (preset `image-size`).
_FOCAL_SHARES: Final = (0.2, 3.0)
# The longest vehicle with a trailer on European roads, metres (Directive 96/53/EC).
_LONGEST_VEHICLE_M: Final = 18.75
# Half way between upright and lying.
_UPRIGHT_FROM: Final = cos(pi / 4.0)
_STEPS: Final = 2000


class KnownLens(NamedTuple):
    """A lens under our model's name, with as many coefficients as the model has."""

    model: ModelName
    K: list[float]
    D: list[float]
    width: int
    height: int


def known_lens(camera: str, lens: FileLens, size: tuple[int, int] | None) -> KnownLens:
    """``size`` is that of the images, for a lens that states none.

    Raises:
        Problem: 422 ``calibration_file_not_read``.
    """
    try:
        model, D = check_lens(camera, lens.distortion_model, lens.K, lens.D)
    except DocumentError as error:
        raise refused(error.message, error.hint) from None
    if lens.size is None and size is None:
        raise refused(
            f"The file says no image size of {camera}.",
            "Give image_size (width, height), or write image_width and image_height into the file.",
        )
    if lens.size is not None and size is not None and lens.size != size:
        (width, height), (own_width, own_height) = size, lens.size
        raise refused(
            f"The lens of {camera} is for {own_width} x {own_height} pixels, but the images have {width} x {height}.",
            "Scale K, or calibrate at this size."
            if lens.size != size[::-1]
            else "Exchange width and height in the file if K is of these images; else calibrate at this size.",
        )
    return KnownLens(model, lens.K, D, *(lens.size or size or (0, 0)))


def lens_doubts(lens: KnownLens) -> list[str]:
    """Return sentences about what is unlikely in a lens."""
    f_x, _, c_x, _, f_y, c_y = lens.K[:6]
    width, height = lens.width, lens.height
    doubts: list[str] = []
    if not (0.0 <= c_x <= width - 1 and 0.0 <= c_y <= height - 1):
        doubts.append(
            f"The principal point ({c_x:.0f}, {c_y:.0f}) lies outside of the image of {width} x {height} pixels: is "
            "the lens for another image size?"
        )
    least, most = (share * width for share in _FOCAL_SHARES)
    if not (least <= f_x <= most and least <= f_y <= most):
        doubts.append(
            f"The focal lengths {f_x:.0f} and {f_y:.0f} px are outside of 0.2 to 3 image widths: are they pixels, "
            "and of this image size?"
        )
    share = _fold_share(lens)
    if share < 1.0:
        doubts.append(
            f"The distortion stops growing at {share:.2f} of the way to the image's nearest edge: are the "
            "coefficients in the order of their model, and is the image size right?"
        )
    return doubts


def _fold_share(lens: KnownLens) -> float:
    """Up to which share of the distance from the image's centre to its nearest edge the radial distortion grows.

    Lenses that fold in the corners are common: polynomials are fitted to what was seen.
    """
    edge = min(lens.width / lens.K[0], lens.height / lens.K[4]) / 2.0
    if lens.model == "kannala_brandt":
        angle = np.linspace(0.0, pi, _STEPS)
        radius = angle * (1.0 + sum(k * angle ** (2 * index + 2) for index, k in enumerate(lens.D)))
        reached = _growing(radius)
    else:
        k1, k2, _, _, k3, k4, k5, k6 = [*lens.D, *[0.0] * 8][:8]
        # A tangent of 20 is 87 degrees: what a radial polynomial says of wider angles is no measurement.
        tangent = np.linspace(0.0, 20.0, 10 * _STEPS)
        squared = tangent**2
        divisor = 1.0 + squared * (k4 + squared * (k5 + squared * k6))
        reached = _growing(tangent * (1.0 + squared * (k1 + squared * (k2 + squared * k3))) / divisor)
    return reached / edge


def _growing(radius: Floats) -> float:
    """The largest radius before the first that is not larger than the one before it."""
    falls = np.flatnonzero(np.diff(radius) <= 0.0)
    return float(radius[falls[0]] if falls.size else radius[-1])


def mount_doubts(T: SE3) -> list[str]:
    """Return sentences about what is unlikely in a mount."""
    doubts: list[str] = []
    distance = float(np.linalg.norm(T.t))
    if distance > _LONGEST_VEHICLE_M:
        doubts.append(
            f"Camera and LiDAR are {distance:.0f} m apart, farther than the longest road vehicle: is the translation "
            "in metres?"
        )
    # Upright or upside down, an image's vertical is near the LiDAR's. Read the wrong way, it is near the horizon.
    if abs(float(T.R[1, 2])) < _UPRIGHT_FROM:
        off = degrees(acos(abs(float(T.R[1, 2]))))
        doubts.append(
            f"The image's vertical is {off:.0f} degrees from the LiDAR's: does the transform lead the other way, or "
            "is its camera frame the body's (x forward, z up) and not the optical one?"
        )
    return doubts
