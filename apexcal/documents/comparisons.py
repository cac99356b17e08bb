"""Differences of results of one camera: two of them, and all in the order of their pairs."""

from __future__ import annotations

from datetime import datetime
from typing import Literal
from uuid import UUID

from apexcal.documents.base import Document, Sent
from apexcal.documents.precision import Deviations
from apexcal.documents.publications import PublicationView
from apexcal.documents.results import Intrinsics, SolvedTransform


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
    """The distance of two results; ``turn_deg`` and ``shift_mm`` about and along the camera's axes.

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
    """The comparison of a result with another one of its camera.

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


class DriftStep(Sent):
    """A result of a camera, and how far it is from the one before it and from the first.

    ``sigmas`` is the mount's difference in what both results state, root mean square; ``differs`` says that chance
    makes such a difference once in 1000. Null where a result states no deviations. ``std`` are its own deviations,
    with the spread between models. ``withdrawn`` is null unless its newest publication was withdrawn: then no later
    result is compared with it.
    """

    result_id: UUID
    calibration_id: UUID
    model: str
    at: datetime
    intrinsics: Intrinsics
    transform: SolvedTransform
    std: Deviations
    from_previous: ResultDifference | None
    from_first: ResultDifference | None
    withdrawn: PublicationView | None


class Drift(Sent):
    """A camera's recommended results, the oldest first, with what their order says in a sentence.

    ``next`` is given as ``after`` to get the results before these, and is null if there are none. Each answer
    compares with the first of its own results that was not withdrawn.
    """

    vehicle_id: UUID
    camera: str
    sentence: str
    steps: list[DriftStep]
    next: str | None = None
