"""Lenses as other programs state them, under the names of our camera models."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

from apexcal.documents.bounds import LEAST_FOCAL_PX
from apexcal.documents.camera_models import CAMERA_MODELS, INTRINSICS, MODELS, ModelName
from apexcal.documents.errors import DocumentError
from apexcal.documents.readings import ImageKind

STATED_MODELS: Final = sorted({stated for model in CAMERA_MODELS.values() for stated in model.stated_as if stated})
"""The distortion models of a CameraInfo, of camera_calibration or of Kalibr that are one of ours."""

# Standard deviations of a calibration that was made elsewhere: focal lengths as a share of themselves, the centre as
# a share of the image's width, and of a coefficient so much and a tenth of itself. The five calibrations that KITTI
# publishes of each colour camera (Geiger et al. 2013, 26 September to 3 October 2011) spread by 0.15 to 0.25 % in f,
# 0.1 % of the width in c_x and 0.5 % in c_y. Five tell a deviation to a factor of two, hence f twice as wide.
_FOCAL_SIGMA: Final = 0.005
_CENTRE_SIGMA: Final = 0.005
_COEFFICIENT_SIGMA: Final = 0.02
_TANGENTIAL_SIGMA: Final = 0.002


class ModelOfLens(NamedTuple):
    """Our camera model of a stated lens.

    Attributes:
        model: None if no model has that name; the model with the most coefficients if D has more than any.
        D: as many coefficients as the model has, missing ones 0; None where it has too few.
    """

    model: ModelName | None
    D: list[float] | None


def model_of_lens(distortion_model: str, D: Sequence[float]) -> ModelOfLens:
    """Our camera model of a stated distortion, however its letters are written: the first that holds all of D."""
    name = distortion_model.strip().lower()
    named: list[ModelName] = [model for model in MODELS if name in CAMERA_MODELS[model].stated_as]
    for model in named:
        # OpenCV has 4, 5 or 8 of them, never 6 or 7.
        if model == "rational_polynomial" and 5 < len(D) < 8:
            continue
        if (coefficients := coefficients_of(model, D)) is not None:
            return ModelOfLens(model, coefficients)
    return ModelOfLens(named[-1] if named else None, None)


def check_lens(
    camera: str, distortion_model: str, K: Sequence[float], D: Sequence[float]
) -> tuple[ModelName, list[float]]:
    """Our camera model of a lens as people or files state it, K by rows, and as many coefficients as it has.

    Raises:
        DocumentError: ``unknown_distortion_model``, ``distortion_without_equal``, ``invalid_intrinsics``.
    """
    model, coefficients = model_of_lens(distortion_model, D)
    if model is None:
        raise DocumentError(
            "unknown_distortion_model",
            f"The lens of {camera} is of the distortion model {distortion_model!r}, which is not supported.",
            f"Supported are {', '.join(STATED_MODELS)}. Leave the lens out of a request, or give its focal lengths "
            "and centre as bounds of the rig or the request.",
        )
    if coefficients is None:
        raise DocumentError(
            "distortion_without_equal",
            f"The lens of {camera} has {len(D)} coefficients ({distortion_model}), and {model} has "
            f"{len(CAMERA_MODELS[model].distortion)}: the further ones are not zero, and no model has them.",
            "Calibrate it as plumb_bob (k1 k2 p1 p2 k3), rational_polynomial (k1 k2 p1 p2 k3 k4 k5 k6) or "
            "equidistant (k1 k2 k3 k4), or give focal lengths and centre as bounds of the rig or the request.",
        )
    if min(K[0], K[4]) < LEAST_FOCAL_PX or K[3] != 0.0 or list(K[6:]) != [0.0, 0.0, 1.0]:
        raise DocumentError(
            "invalid_intrinsics",
            f"K of {camera} is no camera matrix: it is [f_x, s, c_x, 0, f_y, c_y, 0, 0, 1], by rows, in pixels.",
            "A CameraInfo without a calibration has zeros there.",
        )
    return model, coefficients


def coefficients_of(model: ModelName, D: Sequence[float]) -> list[float] | None:
    """Return as many coefficients as the model has, missing ones 0; None if D has further ones that are not 0."""
    size = len(CAMERA_MODELS[model].distortion)
    return None if any(D[size:]) else [*D[:size], *[0.0] * (size - len(D))]


def lens_of_images(stated: Mapping[str, Any], kind: ImageKind | None) -> dict[str, Any] | None:
    """The lens of raw or rectified images, of what a ``StatedLens`` says; None where it has no P for rectified ones.

    That of rectified images is P[:, :3] without distortion, a pinhole's. P[:, 3] is a stereo camera's baseline.
    """
    if kind != "rectified":
        return dict(stated)
    P = stated.get("P")
    return P and {**stated, "model": "brown_conrady", "K": [*P[:3], *P[4:7], *P[8:11]], "D": [0.0] * 5}


def stated_deviation(model: ModelName, name: str, value: float, width: float) -> float:
    """Return the standard deviation of a stated lens's parameter, for images of that width, px."""
    if name in ("f_x", "f_y"):
        return _FOCAL_SIGMA * value
    if name in ("c_x", "c_y"):
        return _CENTRE_SIGMA * float(width)
    small = name == "skew" or name in CAMERA_MODELS[model].tangential
    return (_TANGENTIAL_SIGMA if small else _COEFFICIENT_SIGMA) + 0.1 * abs(value)


def parameters_of(stated: Mapping[str, Any], model: ModelName) -> dict[str, float] | None:
    """Return every intrinsic parameter of a model for a ``StatedLens``; None for a lens of another distortion."""
    f_x, s, c_x, _, f_y, c_y = stated["K"][:6]
    of: ModelName | None = stated["model"]
    plain = model == "pinhole" and of == "brown_conrady" and not any(stated["D"])
    if of is None or (not plain and model != of) or (s and "skew" not in INTRINSICS[model]):
        return None
    coefficients = dict(zip(CAMERA_MODELS[of].distortion, stated["D"], strict=True))
    values: dict[str, float] = {"f_x": f_x, "f_y": f_y, "c_x": c_x, "c_y": c_y, "skew": s / f_x, **coefficients}
    return {name: float(values[name]) for name in INTRINSICS[model]}
