"""What the comparison of two results of one camera looks like."""

from __future__ import annotations

from typing import Literal
from uuid import UUID

from apexcal.documents.base import Document, Sent


class ParameterDifference(Sent):
    """A parameter of the result minus that of the other one.

    ``std`` is the deviation of this difference by what both state, ``sigmas`` the difference in it; null where one of
    them does not state a deviation. ``rotation_x`` and so on are small turns about the camera's axes.
    """

    name: str
    unit: Literal["deg", "mm", "px", ""]
    difference: float
    std: float | None
    sigmas: float | None


class FieldDifference(Sent):
    """Where the two results project fixed points around the LiDAR that both show, in columns.

    ``u`` and ``v`` are the pixels of the result, ``du`` and ``dv`` these minus those of the other one. ``sigma_px``
    is the deviation of each coordinate's difference by what both state. ``distance_m`` is from the LiDAR.
    """

    distance_m: list[float]
    u: list[float]
    v: list[float]
    du: list[float]
    dv: list[float]
    sigma_px: list[float]


class ResultDifference(Document):
    """How far apart two results are; ``turn_deg`` and ``shift_mm`` about and along the camera's axes.

    ``sigmas`` and ``differs`` as in :class:`ResultComparison`. ``incomparable`` says why the difference does not tell
    that the mount moved; ``differs`` is false then.
    """

    rotation_deg: float
    translation_mm: float
    turn_deg: list[float]
    shift_mm: list[float]
    sigmas: float
    differs: bool
    incomparable: str | None
    field_px: float | None
    field_sigmas: float | None


class ResultComparison(Sent):
    """How far a result is from another one of its camera.

    ``sigmas`` is the root mean square of the mount's difference in what both state; ``differs``: by more than chance
    does once in 1000. Null where a result states no deviations. ``field_px`` and ``field_sigmas`` are root mean
    squares over ``field``, null if no point is in both images. ``shares_pairs``: both were fitted to pairs of one set
    or recording, so their errors are not independent and ``sigmas`` says too little.
    """

    result_id: UUID
    other_id: UUID
    vehicle_id: UUID
    camera: str
    model: str
    other_model: str
    sentence: str
    shares_pairs: bool
    rotation_deg: float
    translation_mm: float
    sigmas: float | None
    differs: bool | None
    field_px: float | None
    field_sigmas: float | None
    image_size: tuple[int, int] | None
    parameters: list[ParameterDifference]
    field: FieldDifference | None
