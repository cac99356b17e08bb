"""The contents of a calibration file, in our conventions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import isfinite, prod
from typing import Any

import numpy as np

from apexcal.documents.errors import GeometryError
from apexcal.geometry.se3 import SE3, Floats
from service.platform.http.problems import Problem, unprocessable

LIDAR = "lidar"
# As of the transforms and lenses that requests bring: products of larger numbers are no numbers.
_LARGEST = 1e6
# Neither a radial-tangential lens with thin prisms nor a matrix has more.
_MOST_NUMBERS = 64


@dataclass(frozen=True)
class FileLens:
    """A lens: K by rows in pixels, D in the order of its distortion model. The size is None if the file has none."""

    distortion_model: str
    K: list[float]
    D: list[float]
    size: tuple[int, int] | None


@dataclass(frozen=True)
class FileCamera:
    """One camera. ``T_camera_lidar`` has the frames ``name`` and :data:`LIDAR`, or those that the file names."""

    name: str
    topic: str | None = None
    lens: FileLens | None = None
    T_camera_lidar: SE3 | None = None


@dataclass(frozen=True)
class Contents:
    """The cameras of a file, the transforms between them, and what was left out, in sentences."""

    cameras: Sequence[FileCamera]
    camera_transforms: Sequence[SE3] = ()
    notes: list[str] = field(default_factory=list[str])


def refused(what: str, hint: str) -> Problem:
    """A calibration file that cannot be used."""
    return unprocessable("calibration_file_not_read", what, hint)


def transform(to_frame: str, from_frame: str, R: Floats, t: Floats) -> SE3:
    """A transform. Raises :class:`Problem` ``calibration_file_not_read`` where it is none."""
    try:
        return SE3(to_frame, from_frame, R, t)
    except GeometryError as error:
        raise refused(
            f"The transform from {from_frame} to {to_frame} cannot be used. {error.message}", error.hint
        ) from None


def numbers(where: str, values: Any, count: int | None = None) -> list[float]:
    """Plain numbers of a list, of a list of rows, or of a matrix with its shape (``data``).

    Raises :class:`Problem` ``calibration_file_not_read``.
    """
    flat: list[Any] = []
    values = values.get("data") if isinstance(values, dict) else values
    for value in values if isinstance(values, list) else [values]:
        flat += value if isinstance(value, list) else [value]
        if len(flat) > _MOST_NUMBERS:
            raise refused(f"{where} has more than {_MOST_NUMBERS} numbers.", "Send the file as it was written.")
    listed = [_number(where, value) for value in flat]
    if count is not None and len(listed) != count:
        raise refused(f"{where} has {len(listed)} numbers, not {count}.", "Send the file as it was written.")
    return listed


def _number(where: str, value: Any) -> float:
    # YAML 1.1 takes 1e-05 for text.
    try:
        number = float(value) if isinstance(value, int | float | str) and not isinstance(value, bool) else None
    except (ValueError, OverflowError):
        number = None
    if number is None or not isfinite(number) or abs(number) > _LARGEST:
        shown = repr(value)[:40]
        raise refused(f"{where} holds {shown}.", f"Every number in it must be finite and at most {_LARGEST:g}.")
    return number


def image_size(where: str, width: Any, height: Any) -> tuple[int, int]:
    """Raises :class:`Problem` ``calibration_file_not_read`` where these are no two whole numbers of pixels."""
    pixels = numbers(where, [width, height], 2)
    if any(count != int(count) or not 1 <= count <= 32768 for count in pixels):
        raise refused(f"{where} are {pixels[0]:g} x {pixels[1]:g} pixels.", "Both are whole numbers up to 32768.")
    return int(pixels[0]), int(pixels[1])


def matrix(where: str, values: Any, *shape: int) -> Floats:
    """A matrix, or a vector, of this shape. Raises :class:`Problem` ``calibration_file_not_read``."""
    return np.reshape(numbers(where, values, prod(shape)), shape)


def camera_matrix(f_x: float, f_y: float, c_x: float, c_y: float) -> list[float]:
    """K by rows."""
    return [f_x, 0.0, c_x, 0.0, f_y, c_y, 0.0, 0.0, 1.0]
