"""Lenses as other programs state them, under the names of our camera models."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from apexcal.documents.camera_models import CAMERA_MODELS, ModelName
from apexcal.documents.readings import ImageKind

MODEL_OF: Final[dict[str, ModelName]] = {
    stated: name for name, model in CAMERA_MODELS.items() for stated in model.stated_as
}
"""Our camera model by the distortion model of a CameraInfo, of camera_calibration or of Kalibr."""


def model_stated(distortion_model: str) -> ModelName | None:
    """Our camera model of a stated distortion model, however its letters are written; None where there is none."""
    return MODEL_OF.get(distortion_model.strip().lower())


def coefficients_of(model: ModelName, D: Sequence[float]) -> list[float] | None:
    """As many coefficients as the model has, missing ones 0; None where D has further ones that are not 0."""
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
